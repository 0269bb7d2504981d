"""The environment keeps Gymnasium's contract and its own."""

import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sbm_gym
from labeling.core.types import Box3d
from sbm_gym.env import fixation_env
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.env.gaze import yaw_action, yaw_offset_rad
from sbm_gym.env.observations import encode_depth
from sbm_gym.env.rewards import RewardWeights
from sbm_gym.env.state_vector import free_distances_m
from sbm_gym.registration import ENV_IDS, register_envs
from sbm_gym.robot.body import BodyConfig
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.robot.object_memory import MemoryConfig
from sbm_gym.worlds.world import World

from ..box_rooms import BoxRooms
from ..rollouts import digest, rollout_digest

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def env():
    with FixationEnv(BoxRooms()) as made:
        yield made


def make(**kwargs) -> gym.Env:
    return gym.make("sbm_gym:sbm_gym/Indoor-v0", **{"worlds": BoxRooms(), **kwargs})


def test_registration_can_be_repeated():
    before = dict(gym.registry)
    register_envs()
    assert dict(gym.registry) == before
    assert sbm_gym.ENV_IDS is ENV_IDS


@pytest.mark.slow
@pytest.mark.parametrize("kwargs", [{}, {"worlds": "indoor", "split": "val"}], ids=["box rooms", "furnished rooms"])
def test_same_seed_gives_the_same_rollout_bit_for_bit_in_a_fresh_process(kwargs):
    here = rollout_digest(3, **kwargs)
    if not kwargs:
        assert rollout_digest(3) == here
        assert rollout_digest(4) != here
    program = f"from tests.sbm_gym.rollouts import rollout_digest; print(rollout_digest(3, **{kwargs!r}))"
    fresh = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=ROOT)
    assert fresh.stdout.strip() == here


def test_evidence_pays_what_the_robot_believes_and_changes_nothing_else():
    plain, env = make(reward="views"), make(reward="evidence")
    first, _ = plain.reset(seed=2)
    observation, info = env.reset(seed=2)
    assert set(info["reward_terms"]) == {"labels", "discovery", "collision", "step"}
    plain.action_space.seed(2)
    before = env.unwrapped.knowledge.beliefs.expected_labels
    labels, found_at = 0.0, set()
    for step in range(1, 26):
        assert all(np.array_equal(first[name], observation[name]) for name in first)
        action = plain.action_space.sample()
        first, *_ = plain.step(action)
        observation, reward, *_, info = env.step(action)
        assert reward == sum(info["reward_terms"].values())
        found = env.unwrapped.knowledge.beliefs.update.found
        assert info["reward_terms"]["discovery"] == pytest.approx(0.5 * found * (1.0 - step / 25))
        found_at |= {step} if found else set()
        labels += info["reward_terms"]["labels"]
    after = env.unwrapped.knowledge.beliefs.expected_labels
    assert labels == pytest.approx(RewardWeights().label * (after - before))
    assert after > before
    assert len(found_at) > 1
    assert max(found_at) > 5
    # Asked for at the end alone, beliefs are those that were kept from step to step.
    assert plain.unwrapped.knowledge.beliefs.expected_labels == pytest.approx(after)


def test_reward_is_the_sum_of_its_terms_and_terms_follow_their_weights():
    env = make(reward_weights=RewardWeights(step=0.125))
    env.action_space.seed(1)
    rewards = []
    for step in range(75):
        if step % 25 == 0:
            env.reset(seed=step)
        # Turning on the spot finds something; random steps then see it from elsewhere.
        action = np.array([0, 0, 1, 0]) if step % 25 < 6 else env.action_space.sample()
        _, reward, terminated, _, info = env.step(action)
        assert reward == sum(info["reward_terms"].values())
        assert info["reward_terms"]["step"] == -0.125
        assert (info["reward_terms"]["collision"] < 0) == info["collided"]
        assert not terminated
        rewards.append(reward)
    assert len(set(rewards)) > 2


@pytest.mark.parametrize(
    ("made", "steps"),
    [
        (lambda: make(), 25),
        (lambda: make(num_views=40, max_episode_steps=40), 40),
        (lambda: make(num_views=7), 7),
        (lambda: FixationEnv(BoxRooms()), 25),
        (lambda: FixationEnv(BoxRooms(), num_views=30), 30),
    ],
)
def test_episodes_last_as_long_as_asked_and_time_runs_out_evenly(made, steps):
    env = made()
    observation, _ = env.reset(seed=0)
    at = env.unwrapped.state_names.index("time_left")
    left = [observation["state"][at]]
    truncated = False
    while not truncated:
        observation, _, _, truncated, _ = env.step(np.zeros(4, np.float32))
        left.append(observation["state"][at])
    assert len(left) == steps + 1
    assert np.allclose(left, np.linspace(1.0, 0.0, steps + 1), atol=1e-6)


def test_episodes_cut_short_by_a_time_limit_alone_are_warned_of_once():
    env = make(max_episode_steps=10)
    with pytest.warns(UserWarning, match="give gym.make num_views=10 instead") as told:
        env.reset(seed=0)
    assert len(told) == 1
    for made in (env, make(), make(num_views=10), make(num_views=10, max_episode_steps=10), make(max_episode_steps=40)):
        made.reset(seed=0)  # warnings are errors here
    assert env.spec is not None
    assert gym.make(env.spec).spec == env.spec
    assert pickle.loads(pickle.dumps(make(num_views=10))).reset(seed=0)


def confirmed_env(env, gaze_seed=0):
    """An episode with a fixation target, found by turning on the spot."""
    for seed in range(gaze_seed, gaze_seed + 20):
        _, info = env.reset(seed=seed)
        for _ in range(6):
            if info["fixation_target"]:
                return info
            *_, info = env.step(np.array([0, 0, 1, 0]))
    raise AssertionError("no seed led to a confident detection")


def test_a_fixated_target_stays_in_the_middle_of_the_picture(env):
    info = confirmed_env(env)
    rng = np.random.default_rng(0)
    for _ in range(10):
        angle = rng.uniform(0, 2 * np.pi)
        before = info["fixation_target"]["centroid_m"]
        *_, info = env.step(np.array([np.cos(angle), np.sin(angle), 0, 0]))
        pose, k = info["agent"]["camera_to_world"], info["agent"]["intrinsics"]
        local = pose[:3, :3].T @ (before - pose[:3, 3])
        assert np.allclose(k[:2, :2] @ (local[:2] / local[2]), 0.0, atol=1e-6)


@pytest.mark.parametrize(("action", "offset_deg"), [(0.1, 4.635), (-0.5, -39.375), (1.0, 180.0)])
def test_gaze_yaw_points_the_camera_so_far_to_the_left_of_the_target(env, action, offset_deg):
    info = confirmed_env(env)
    before = info["fixation_target"]["centroid_m"]
    *_, info = env.step(np.array([0, 0, action, 0]))
    offset = before[:2] - info["agent"]["position_m"]
    bearing = np.arctan2(offset[1], offset[0])
    assert np.cos(info["agent"]["yaw_rad"] - bearing - np.deg2rad(offset_deg)) == pytest.approx(1.0)


@given(st.floats(-np.pi, np.pi))
def test_every_direction_has_a_gaze_yaw(offset_rad):
    action = yaw_action(offset_rad)
    assert abs(action) <= 1.0 + 1e-9
    assert yaw_offset_rad(action) == pytest.approx(offset_rad, abs=1e-9)


def test_what_the_robot_looks_straight_at_becomes_its_fixation_target():
    env = FixationEnv(BoxRooms(), memory=MemoryConfig(confident=0.4))
    taken = 0
    for seed in range(4):
        _, info = env.reset(seed=seed)
        for step in range(25):
            others = [known for known in info["confirmed_objects"] if known["visible"]]
            before, action = info["fixation_target"], np.array([0.0, 0.0, 0.3 if step % 2 else -0.5, 0.0])
            if len(others) > 1 and before:
                wanted = next(known for known in others if known["object_id"] != before["object_id"])
                here = info["agent"]["position_m"]
                directions = [np.arctan2(*(known["centroid_m"][:2] - here)[::-1]) for known in (wanted, before)]
                action = np.array([0, 0, yaw_action(float(wrap(directions[0] - directions[1]))), 0])
                *_, info = env.step(action)
                seen = {known["object_id"]: known["visible"] for known in info["confirmed_objects"]}
                if seen[wanted["object_id"]] and abs(wrap(directions[0] - directions[1])) > np.deg2rad(15):
                    taken += 1
                    assert info["fixation_target"]["object_id"] != before["object_id"]
            else:
                *_, info = env.step(action)
            target = info["fixation_target"]
            if target:
                # Nothing visible is nearer to the middle of the picture by ten degrees.
                place = info["agent"]["camera_to_world"][:2, 3]
                off = {
                    known["object_id"]: abs(
                        wrap(np.arctan2(*(known["centroid_m"][:2] - place)[::-1]) - info["agent"]["yaw_rad"])
                    )
                    for known in info["confirmed_objects"]
                    if known["visible"] or known["object_id"] == target["object_id"]
                }
                assert off[target["object_id"]] <= min(off.values()) + np.deg2rad(10) + 1e-6
    assert taken > 5


def test_free_gaze_turns_by_sixty_degrees_even_with_a_target():
    env = FixationEnv(BoxRooms(), gaze="free")
    info = confirmed_env(env)
    yaw = info["agent"]["yaw_rad"]
    *_, info = env.step(np.array([0, 0, -0.5, 0]))
    assert np.cos(info["agent"]["yaw_rad"] - yaw + np.deg2rad(30)) == pytest.approx(1.0)


def test_forward_and_left_are_relative_to_the_heading_and_a_stride_long(env):
    _, info = env.reset(seed=0, options={"scene": "box_0", "start": (-1.0, -1.5, np.pi / 2)})
    start = info["agent"]["position_m"]
    *_, info = env.step(np.array([1.0, 0, 0, 0]))
    assert np.allclose(info["agent"]["position_m"] - start, [0.0, 0.5], atol=1e-3)
    _, info = env.reset(seed=0, options={"scene": "box_0", "start": (-1.0, -1.5, np.pi / 2)})
    *_, info = env.step(np.array([1.0, 1.0, 0, 0]))
    assert np.allclose(info["agent"]["position_m"] - start, np.sqrt(0.125) * np.array([-1, 1]), atol=1e-3)
    assert info["path_length_m"] == pytest.approx(0.5, abs=1e-3)


def test_observations_show_what_the_renderer_shows(env):
    observation, info = env.reset(seed=2)
    capture = env.capture(84, 84)
    assert np.array_equal(observation["depth"], encode_depth(capture.depth_m))
    seen = capture.depth_m > 0
    assert np.all(
        np.abs(observation["depth"][..., 0] * 0.04 - capture.depth_m)[seen & (capture.depth_m < 10)] <= 0.0201
    )
    assert np.mean(np.abs(observation["rgb"].astype(float) - capture.rgb)) < 6
    assert np.allclose(capture.camera_to_world, info["agent"]["camera_to_world"])


def test_capturing_does_not_change_the_rollout():
    def rewards(capture: bool) -> list:
        env = FixationEnv(BoxRooms())
        env.reset(seed=5)
        env.action_space.seed(5)
        found = []
        for _ in range(8):
            observation, reward, *_ = env.step(env.action_space.sample())
            found.append((reward, observation["state"].tobytes(), observation["rgb"].tobytes()))
            if capture:
                first, second = env.capture(64, 64), env.capture(64, 64)
                assert first.detections == second.detections
        return found

    assert rewards(True) == rewards(False)


class MisnamedRooms(BoxRooms):
    """Box rooms that look the same, of which the simulator believes other things: ids, categories and boxes."""

    def build(self, scene: str) -> World:
        world = super().build(scene)
        objects = []
        for k, one in enumerate(world.objects):
            other, third = (world.objects[(k + step) % len(world.objects)] for step in (1, 2))
            centre_m, extent_m = third.box_3d.centre_m + np.array([0.7, -0.4, 0.3]), 1.3 * third.box_3d.extent_m
            box = Box3d(centre_m, extent_m, third.box_3d.rotation)
            objects.append(replace(one, instance_id=other.instance_id, category=third.category, box_3d=box))
        return replace(world, objects=tuple(objects))


class Replay:
    """A detector that says at each step what it is told to, whatever it is shown."""

    name, needs_detail, categories = "compact", False, ("chair", "couch", "fridge", "table", "tv")

    def __init__(self, said: list) -> None:
        self.said = said

    def detect(self, scene, view, step_index, entropy) -> list:
        return self.said[step_index]


@pytest.mark.parametrize("reward", ["views", "evidence"])
def test_rewards_and_observations_never_use_ground_truth(reward, monkeypatch):
    settings = {"memory": MemoryConfig(confident=0.4), "reward": reward}

    def play(env: FixationEnv) -> list[tuple]:
        found = [(*env.reset(seed=0), 0.0)]
        env.action_space.seed(0)
        for _ in range(25):
            observation, paid, _, _, info = env.step(env.action_space.sample())
            found.append((observation, info, paid))
        return found

    said = [info["detections"] for _, info, _ in play(FixationEnv(BoxRooms(), **settings))]
    monkeypatch.setattr(fixation_env, "make_detector", lambda *_, **__: Replay(said))
    envs = [FixationEnv(rooms, **settings) for rooms in (BoxRooms(), MisnamedRooms())]
    true, misnamed = (play(env) for env in envs)
    for one, other in zip(*(env.scene.world.objects for env in envs), strict=True):
        assert one.body_name == other.body_name
        assert one.instance_id != other.instance_id
        assert one.category != other.category
        assert not np.allclose(one.box_3d.centre_m, other.box_3d.centre_m)
    for (observation, info, paid), (other, other_info, other_paid) in zip(true, misnamed, strict=True):
        assert all(np.array_equal(observation[name], other[name]) for name in observation)
        assert paid == other_paid
        assert digest(info) == digest(other_info)
    # There was something to be paid for: a target, and new sides or labels of it.
    assert sum(bool(info["fixation_target"]) for _, info, _ in true) > 10
    term = {"views": "diversity", "evidence": "labels"}[reward]
    assert sum(info["reward_terms"]["discovery"] > 0.0 for _, info, _ in true) > 1
    assert sum(info["reward_terms"][term] > 0.0 for _, info, _ in true) > 3


def test_writing_to_info_changes_nothing_that_the_robot_knows():
    def beliefs(write: bool) -> list:
        env = FixationEnv(BoxRooms(), memory=MemoryConfig(confident=0.4))
        env.action_space.seed(1)
        _, info = env.reset(seed=1)
        for _ in range(8):
            if write:
                info["sight"]["depth_m"][:] = 0.1
                info["sight"]["intrinsics"][:] = 7.0
                info["agent"]["camera_to_world"][:] = 0.0
            _, _, _, _, info = env.step(env.action_space.sample())
        return [(one.category, one.chance, one.side.tolist()) for one in env.knowledge.beliefs.things]

    assert beliefs(write=True) == beliefs(write=False) != []


def test_state_tells_of_objects_and_candidates_what_info_says_of_them():
    env = FixationEnv(BoxRooms(), memory=MemoryConfig(confident=0.4))  # confirms more than the usual one or two
    told = doubtful = 0
    for seed in range(3):
        observation, info = env.reset(seed=seed)
        env.action_space.seed(seed)
        for _ in range(25):
            state = dict(zip(env.state_names, observation["state"].tolist(), strict=True))
            agent, target = info["agent"], info["fixation_target"]
            eye = agent["camera_to_world"][:3, 3]
            others = [known for known in info["confirmed_objects"] if known["object_id"] != target["object_id"]]
            others.sort(key=lambda known: np.linalg.norm((known["centroid_m"] - eye)[:2]))
            assert state["target_known"] == bool(target)
            for k in range(4):
                assert state[f"other_{k}_known"] == (k < len(others))
            named = {f"other_{k}": known for k, known in enumerate(others[:4])} | ({"target": target} if target else {})
            for name, known in named.items():
                check_place(state, name, known["centroid_m"], agent)
                offset = known["centroid_m"] - eye
                here = env.knowledge.view_bins.azimuth_bin(float(np.arctan2(-offset[1], -offset[0])))
                covered = {(sector - here) % 18 for sector in known["azimuths"]}
                assert {k for k in range(18) if state[f"{name}_sector_{k}_covered"]} == covered
                assert state[f"{name}_azimuths_covered"] == pytest.approx(len(covered) / 18)
                assert state[f"{name}_visible"] == known["visible"]
                told += 1
            candidates = sorted(
                env.knowledge.view_history.candidates, key=lambda one: -one.confidence * 0.4 ** len(one.looks)
            )
            for k, one in enumerate(candidates[:3]):
                assert state[f"candidate_{k}_confidence"] == pytest.approx(one.confidence)
                check_place(state, f"candidate_{k}", one.centroid_m, agent)
                doubtful += 1
            observation, _, _, _, info = env.step(env.action_space.sample())
    assert told > 40
    assert doubtful > 20


def test_open_sectors_are_those_with_a_place_to_see_the_object_from():
    env = FixationEnv(BoxRooms(), memory=MemoryConfig(confident=0.4))
    told, is_open = 0, 0
    for seed in range(4):
        observation, _ = env.reset(seed=seed)
        env.action_space.seed(seed)
        for _ in range(12):
            observation, _, _, _, info = env.step(env.action_space.sample())
            state = dict(zip(env.state_names, observation["state"].tolist(), strict=True))
            target = info["fixation_target"]
            if not target:
                assert not any(state[f"target_sector_{k}_open"] for k in range(18))
                continue
            centre, known = target["centroid_m"], env.knowledge
            away = info["agent"]["camera_to_world"][:2, 3] - centre[:2]
            here = env.knowledge.view_bins.azimuth_bin(float(np.arctan2(away[1], away[0])))
            for k in range(18):
                angle = np.deg2rad(((here + k) % 18) * 20 + 10)
                places = [centre[:2] + d * np.array([np.cos(angle), np.sin(angle)]) for d in (1.3, 1.8)]
                stop_short = 0.25 + 0.5 * float(np.max(target["extent_m"]))
                expected = any(
                    env.knowledge.navigable.is_free(place)
                    and bool(known.seen_space.sees(np.array([[*place, 1.5]]), centre, stop_short)[0])
                    for place in places
                )
                assert state[f"target_sector_{k}_open"] == expected
                told, is_open = told + 1, is_open + expected
    assert 0.2 * told < is_open < 0.95 * told


def wrap(angle_rad):
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi


def check_place(state, name, point, agent):
    """The range and direction of something, as the state vector tells them, against camera axes."""
    pose = agent["camera_to_world"]
    offset = point - pose[:3, 3]
    flat = np.array([np.cos(agent["yaw_rad"]), np.sin(agent["yaw_rad"])])
    distance = np.hypot(*offset[:2])
    assert state[f"{name}_range"] == pytest.approx(min(distance / 5.0, 1.0), abs=1e-5)
    assert state[f"{name}_ahead"] == pytest.approx(offset[:2] @ flat / distance, abs=1e-5)
    assert state[f"{name}_left"] == pytest.approx((flat[0] * offset[1] - flat[1] * offset[0]) / distance, abs=1e-5)


def test_free_space_is_what_the_map_says(env):
    env.reset(seed=0, options={"scene": "box_0", "start": (-1.0, -1.5, 0.0)})
    free = free_distances_m(env.knowledge.navigable, np.array([-1.0, -1.5]), 0.0)
    for k, distance in enumerate(free):
        direction = np.array([np.cos(k * np.pi / 8), np.sin(k * np.pi / 8)])
        assert env.knowledge.navigable.line_is_free(
            np.array([-1.0, -1.5]), np.array([-1.0, -1.5]) + 0.95 * distance * direction
        )
    # A wall 1.5 m behind the robot's right, less its radius and a cell of the map.
    assert free[12] == pytest.approx(1.5 - 0.18, abs=0.08)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"scenes": "box_0"}, "scene, start, reuse_scene"),
        ({"scene": "attic"}, "box_0"),
        ({"start": (50.0, 0.0)}, "nearest free place"),
        ({"start": (1.0,)}, "yaw"),
    ],
)
def test_reset_names_the_alternatives(env, options, says):
    with pytest.raises(ValueError, match=says):
        env.reset(seed=0, options=options)


@pytest.mark.parametrize(
    ("argument", "says"),
    [
        ({"split": "training"}, "train, val, test"),
        ({"body": BodyConfig(radius_m=0.35)}, "radius_m must be above 0 and at most 0.18 m"),
        ({"body": BodyConfig(radius_m=0.0)}, "radius_m must be above 0"),
        ({"detector": "yolo"}, "simulated"),
        ({"renderer": "raster"}, "auto, rays"),
        ({"gaze": "stare"}, "fixate, free"),
        ({"render_mode": "ansi"}, "rgb_array, depth_array, third_person"),
        ({"num_views": 0}, "at least 1"),
        ({"num_views": 2.5}, "num_views must be a whole number of at least 1, not 2.5"),
        ({"episodes_per_scene": True}, "episodes_per_scene must be a whole number"),
        ({"stride_m": 0.0}, "positive"),
        ({"stride_m": float("inf")}, "positive and at most 10 m, not inf"),
        ({"stride_m": "far"}, "not 'far'"),
        ({"image_size": (100_000, 100_000)}, "image_size: 100000x100000 pixels are more than the"),
        ({"image_size": "large"}, "image_size must be height and width, two whole numbers above 0, not 'large'"),
        ({"detector_size": (0, 5)}, "detector_size must be height and width"),
        ({"render_size": (64.0, 64)}, "render_size must be height and width"),
        ({"moving": 2.5}, "moving must be a whole number of at least 0, not 2.5"),
        ({"detector": 5}, "detector is a name or a SimulatedDetectorConfig, not 5"),
        ({"worlds": "moon"}, "indoor"),
        ({"worlds": 5}, "worlds is a name .* or an object that builds them .* not 5"),
    ],
)
def test_constructor_names_the_alternatives(argument, says):
    with pytest.raises(ValueError, match=says):
        FixationEnv(**{"worlds": BoxRooms(), **argument})


@pytest.mark.parametrize("action", [np.zeros(3), np.full(4, np.nan)])
def test_senseless_actions_are_refused(env, action):
    env.reset(seed=0)
    with pytest.raises(ValueError, match="four finite numbers"):
        env.step(action)


def test_step_before_reset_says_so(env):
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(4))


def test_scene_options_and_reuse(env):
    _, info = env.reset(seed=0, options={"scene": "box_3"})
    assert info["scene"] == "box_3"
    for _ in range(4):
        _, info = env.reset(options={"reuse_scene": True})
        assert info["scene"] == "box_3"
    held = FixationEnv(BoxRooms(), episodes_per_scene=3)
    names = [held.reset(seed=1 if k == 0 else None)[1]["scene"] for k in range(9)]
    assert all(len(set(names[k : k + 3])) == 1 for k in (0, 3, 6))


def test_environments_survive_pickling(env):
    copy = pickle.loads(pickle.dumps(FixationEnv(BoxRooms(), stride_m=0.3, num_views=9)))
    copy.reset(seed=0)
    assert copy.knowledge.stride_m == 0.3
    assert copy.num_views == copy.knowledge.views_left == 9


@pytest.mark.parametrize(
    ("mode", "dtype", "shape"), [("rgb_array", np.uint8, (64, 96, 3)), ("depth_array", np.float32, (64, 96))]
)
def test_render_draws_the_current_view(mode, dtype, shape):
    env = FixationEnv(BoxRooms(), render_mode=mode, render_size=(64, 96))
    env.reset(seed=0)
    picture = env.render()
    assert picture is not None
    assert picture.dtype == dtype
    assert picture.shape == shape
    assert np.ptp(picture) > 0


def test_fixate_changes_the_target_and_refuses_unknown_objects(env):
    confirmed_env(env)
    with pytest.raises(ValueError, match="no confirmed object 99"):
        env.knowledge.fixate(99)
    env.knowledge.fixate(0)


def test_vector_environments_run():
    envs = gym.make_vec("sbm_gym/Indoor-v0", num_envs=2, vectorization_mode="sync", worlds=BoxRooms())
    envs.reset(seed=0)
    for _ in range(30):
        envs.step(envs.action_space.sample())
    envs.close()


@pytest.mark.parametrize("unseen_models", [False, True])
@pytest.mark.parametrize("env_id", list(ENV_IDS))
def test_unseen_models_reach_whoever_builds_the_scenes(env_id, unseen_models, monkeypatch):
    """That training scenes then show no model of test scenes is tested where scenes are built."""
    asked = []

    def build(scene, library=None, unseen_models=False, movable=False):
        asked.append((scene, unseen_models))
        return BoxRooms().build("box_0")

    monkeypatch.setenv("SBM_SCENE_CACHE", "off")
    monkeypatch.setattr("sbm_gym.worlds.rooms.indoor.build_indoor", build)
    monkeypatch.setattr("sbm_gym.worlds.towns.outdoor.build_outdoor", build)
    with gym.make(f"sbm_gym:{env_id}", unseen_models=unseen_models) as env:
        copied = pickle.loads(pickle.dumps(env.unwrapped))
        for each in (env.unwrapped, copied):
            each.reset(seed=0)
            each.close()
    assert [unseen for _, unseen in asked] == [unseen_models] * 2


def test_a_source_of_worlds_decides_by_itself_which_models_are_unseen():
    with pytest.raises(ValueError, match="unseen_models goes with worlds given by name"):
        FixationEnv(BoxRooms(), unseen_models=True)


def test_what_policies_may_ask_is_what_the_contract_names_and_stays_up_to_date(env):
    names = {name for name in {**vars(RobotKnowledge), **RobotKnowledge.__annotations__} if not name.startswith("_")}
    env.reset(seed=0)
    robot = env.knowledge
    assert {name for name in names if hasattr(robot, name)} == names
    assert not {name for name in names if "scene" in name or "world" in name or "truth" in name}
    for step in range(4):
        assert robot.views_left == env.num_views - step
        _, _, _, _, info = env.step(env.action_space.sample())
        assert env.knowledge is robot
        assert [known.object_id for known in robot.objects] == [o["object_id"] for o in info["confirmed_objects"]]
        assert (robot.target is None) == (info["fixation_target"] == {})
    env.reset(seed=1)
    assert env.knowledge is not robot
    assert env.knowledge.views_left == env.num_views
