"""Moves and looks: they do what their numbers say, and never run into what the map shows."""

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.network.checkpoint import write_policy
from agents.network.choice_policy import PARTS
from agents.network.policy_network import build_policy
from agents.network.spaces import describe
from agents.planning.choices import ACTION_SPACE, DIRECTIONS, LOOKS, STAY, free_step
from agents.planning.kernels import unseen_by_way
from agents.planning.moves_and_looks import MovesAndLooks
from agents.planning.promises import LOOK_ENTRIES, MOVE_ENTRIES, UNMAPPED, WITHOUT, with_promises
from agents.policies.ppo import Ppo
from sbm_gym.env.gaze import PITCH_RAD
from sbm_gym.env.state_vector import likely_candidates, nearest_others
from sbm_gym.robot.body import BodyConfig
from sbm_gym.robot.object_memory import MemoryConfig
from sbm_gym.worlds.geometry.navigable import NavigableMap

from ...sbm_gym.box_rooms import BoxRooms

KWARGS = {"width": 8}


def make_env() -> gym.Env:
    # Confirms more than the usual one or two.
    memory = MemoryConfig(confident=0.4)
    return gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=BoxRooms(), memory=memory, colours=False)


def angle_between(a_rad: float, b_rad: float) -> float:
    return abs((a_rad - b_rad + np.pi) % (2.0 * np.pi) - np.pi)


@pytest.mark.slow
def test_choices_do_what_they_say_and_hit_nothing():
    env, rng = MovesAndLooks(make_env()), np.random.default_rng(0)
    looked = dict.fromkeys(LOOKS, 0)
    straight = 0
    for seed in range(6):
        _, info = env.reset(seed=seed)
        robot = env.get_wrapper_attr("knowledge")
        for _ in range(25):
            move, look = int(rng.integers(DIRECTIONS + 1)), int(rng.integers(len(LOOKS)))
            before, target = info["agent"], robot.target
            places = {"target": None if target is None else target.centroid_m}
            camera_m = before["camera_to_world"][:3, 3]
            places |= {f"candidate_{k}": one.centroid_m for k, one in enumerate(likely_candidates(robot))}
            places |= {f"other_{k}": one.centroid_m for k, one in enumerate(nearest_others(robot, camera_m))}
            wanted_m = places.get(str(LOOKS[look]))
            *_, info = env.step(np.array([move, look]))
            after = info["agent"]
            assert not info["collided"]
            moved_m = after["position_m"] - before["position_m"]
            length_m = float(np.linalg.norm(moved_m))
            assert length_m < robot.stride_m + 1e-3
            if move == STAY:
                assert length_m < 1e-3
            elif length_m > 1e-3:
                side_rad = before["yaw_rad"] + move * np.pi / 4
                aside_rad = angle_between(np.arctan2(moved_m[1], moved_m[0]), side_rad)
                assert aside_rad < np.pi / 2 + 1e-2
                straight += aside_rad < 1e-2
            if target is not None and wanted_m is not None:
                offset = wanted_m - after["camera_to_world"][:3, 3]
                assert angle_between(after["yaw_rad"], np.arctan2(offset[1], offset[0])) < 0.02
                fixated = target.centroid_m - after["camera_to_world"][:3, 3]
                middle_rad, up_rad = (np.arctan2(way[2], np.hypot(way[0], way[1])) for way in (fixated, offset))
                up_rad = np.clip(up_rad, middle_rad - PITCH_RAD, middle_rad + PITCH_RAD)
                assert after["tilt_rad"] == pytest.approx(max(up_rad, -BodyConfig().max_tilt_rad), abs=0.03)
                looked[LOOKS[look]] += 1
            elif target is not None and not isinstance(LOOKS[look], str):
                assert angle_between(after["yaw_rad"], before["yaw_rad"] + LOOKS[look]) < 0.02
                looked[LOOKS[look]] += 1
    assert straight > 20
    assert all(looked[what] for what in ("target", "candidate_0", np.pi))


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.integers(0, 19), st.integers(0, 19)), max_size=150),
    st.floats(0.0, 2.0 * np.pi),
    st.floats(0.1, 0.9),
    st.floats(0.1, 0.9),
)
def test_no_step_leaves_the_free_floor(blocked, direction_rad, x, y):
    free = np.ones((20, 20), bool)
    for row, column in blocked:
        free[row, column] = False
    navigable = NavigableMap(free, np.zeros(2))
    start_m = np.array([x, y])
    step_m = free_step(navigable, start_m, 0.3, direction_rad)
    # By brute force: every point of the way.
    if np.any(step_m):
        assert all(navigable.is_free(start_m + share * step_m) for share in np.linspace(0.0, 1.0, 200))
        assert np.linalg.norm(step_m) == pytest.approx(0.3) or np.linalg.norm(step_m) == pytest.approx(0.15)
    ahead_m = start_m + 0.3 * np.array([np.cos(direction_rad), np.sin(direction_rad)])
    if navigable.line_is_free(start_m, ahead_m):
        assert step_m == pytest.approx(ahead_m - start_m)


@pytest.mark.slow
def test_promises_are_what_the_robot_knows():
    env, rng = MovesAndLooks(make_env()), np.random.default_rng(1)
    promised: dict[str, int] = {"target": 0, "others": 0, "candidates": 0}
    for seed in range(4):
        seen, info = env.reset(seed=seed)
        robot = env.get_wrapper_attr("knowledge")
        for _ in range(25):
            assert env.observation_space.contains(seen)
            agent = info["agent"]
            for move in range(DIRECTIONS):
                row = dict(zip(MOVE_ENTRIES, seen["moves"][move].tolist(), strict=True))
                angle = agent["yaw_rad"] + move * np.pi / 4
                step_m = free_step(robot.navigable, agent["position_m"], robot.stride_m, angle)
                assert row["length"] == pytest.approx(np.linalg.norm(step_m) / robot.stride_m, abs=1e-6)
                eye_m = np.array([*(agent["position_m"] + step_m), robot.camera_height_m])
                wanted = {"target": 0.0, "others": 0.0, "candidates": 0.0}
                for known in robot.objects:
                    cell, short_m = robot.view_bins.cell(eye_m, known.centroid_m), 0.25 + 0.5 * known.extent_m.max()
                    new = cell is not None and cell[0] not in known.azimuths
                    if new and robot.seen_space.sees(eye_m[None], known.centroid_m, short_m)[0]:
                        wanted["target" if known is robot.target else "others"] += 1.0 if known is robot.target else 0.5
                for one in robot.view_history.candidates:
                    cell, short_m = robot.view_bins.cell(eye_m, one.centroid_m), 0.25 + 0.5 * one.size_m
                    new = cell is not None and cell[0] not in {cell[0] for cell in one.looks}
                    if new and robot.seen_space.sees(eye_m[None], one.centroid_m, short_m)[0]:
                        wanted["candidates"] += one.confidence
                for kind, value in wanted.items():
                    assert row[f"{kind}_new"] == pytest.approx(min(value, 1.0), abs=1e-6)
                    promised[kind] += value > 0.0
                assert seen["looks"][move, 0, LOOK_ENTRIES.index("new")] == row["target_new"]
                if robot.target is not None:
                    from_end_m = np.linalg.norm(robot.target.centroid_m[:2] - eye_m[:2])
                    ranges = min(1.0, from_end_m / (16.0 * robot.stride_m))
                    assert seen["looks"][move, 0, LOOK_ENTRIES.index("range")] == pytest.approx(ranges, abs=1e-5)
                    towards = robot.target.centroid_m[:2] - agent["position_m"]
                    ahead = np.array([np.cos(angle), np.sin(angle)]) @ towards / np.linalg.norm(towards)
                    assert row["to_target"] == pytest.approx(ahead, abs=1e-5)
            looks = {name: seen["looks"][STAY, :, k] for k, name in enumerate(LOOK_ENTRIES)}
            assert looks["there"][0] == (robot.target is not None)
            assert looks["there"][1:4].sum() == min(3, len(robot.view_history.candidates))
            best = likely_candidates(robot)[:3]
            assert looks["confidence"][1 : 1 + len(best)] == pytest.approx([one.confidence for one in best], abs=1e-6)
            seen, *_, info = env.step(np.array([rng.integers(DIRECTIONS + 1), rng.integers(len(LOOKS))]))
    assert all(promised.values())


def test_a_look_promises_what_it_promises_from_where_the_move_ends():
    # Whoever stands where a move would end and looks the same way is told the same of looks.
    env = MovesAndLooks(make_env())
    compared = 0
    for seed in range(3):
        seen, info = env.reset(seed=seed)
        robot = env.get_wrapper_attr("knowledge")
        for move in range(DIRECTIONS):
            agent = info["agent"]
            step_m = free_step(
                robot.navigable, agent["position_m"], robot.stride_m, agent["yaw_rad"] + move * np.pi / 4
            )
            there = {**info, "agent": {**agent, "position_m": agent["position_m"] + step_m}}
            told = with_promises(seen, there, robot)["looks"][STAY]
            assert seen["looks"][move] == pytest.approx(told, abs=1e-5)
            compared += bool(np.any(step_m))
        seen, *_, info = env.step(np.array([0, 0]))
    assert compared > 10


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 7))
def test_unseen_floor_counts_by_the_length_and_the_side_of_the_way(along, across, turned):
    floor = np.ones((30, 30), bool)
    unseen = np.zeros_like(floor)
    unseen[10 + across, 10 + along] = True
    angles = np.arange(8) * np.pi / 4 + turned * 0.1
    found = unseen_by_way(floor, unseen, 10, 10, 0.3, angles, 0.2)
    # In the open, a king's way: as many diagonal steps as there can be.
    length = 0.3 * (abs(along - across) + np.sqrt(2.0) * min(along, across))
    worth = 0.09 * np.exp(-0.2 * length)
    assert worth * np.cos(np.pi / 8) - 1e-9 <= found.max() <= worth + 1e-9
    assert found.sum() > 0.0
    way_rad = np.arctan2(across, along)
    assert abs(np.angle(np.exp(1j * (angles[np.argmax(found)] - way_rad)))) < np.pi / 3


def test_the_way_to_floor_behind_a_wall_begins_at_its_gap():
    floor = np.ones((21, 21), bool)
    floor[:, 12] = False
    floor[18:20, 12] = True  # the gap, far up (rows count along +Y)
    unseen = np.zeros_like(floor)
    unseen[8:12, 15:18] = True
    sides = np.array([0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi])
    ahead, up, back, down = unseen_by_way(floor, unseen, 10, 10, 0.3, sides, 0.2)
    assert up > ahead
    assert max(back, down) < 1e-12
    floor[18:20, 12] = False
    assert not unseen_by_way(floor, unseen, 10, 10, 0.3, sides, 0.2).any()


@pytest.mark.parametrize("name", sorted(set(WITHOUT) - {"moves_and_looks", UNMAPPED}))
def test_an_ablation_hides_its_entries_and_nothing_else(name):
    whole, part = MovesAndLooks(make_env()), MovesAndLooks(make_env(), name)
    told = set()
    for seen, partly in zip(play(whole), play(part), strict=True):
        for rows, entries in (("moves", MOVE_ENTRIES), ("looks", LOOK_ENTRIES)):
            for column, entry in enumerate(entries):
                expected = 0.0 if entry in WITHOUT[name] else seen[rows][..., column]
                assert np.array_equal(partly[rows][..., column], np.broadcast_to(expected, partly[rows].shape[:-1]))
                told |= {entry} if seen[rows][..., column].any() else set()
    assert set(WITHOUT[name]) <= told


def play(env):
    """What is seen in the first steps of an episode, with actions that do not depend on it."""
    rng = np.random.default_rng(5)
    seen, _ = env.reset(seed=3)
    yield seen
    for _ in range(20):
        seen, *_ = env.step(rng.integers(ACTION_SPACE.nvec))
        yield seen


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(WITHOUT))
def test_a_checkpoint_acts_as_in_training(tmp_path, name):
    wrapped, env = MovesAndLooks(make_env(), name), make_env()
    space = gym.spaces.Dict({name: wrapped.observation_space[name] for name in PARTS})  # type: ignore[index]
    network = build_policy(space, ACTION_SPACE, "ChoicePolicy", KWARGS)
    description = {
        "env": "sbm_gym/Indoor-v0",
        "observation_space": describe(space),
        "action_space": describe(ACTION_SPACE),
        "policy": {"class": "ChoicePolicy", "kwargs": KWARGS},
        "hyperparameters": {"env_wrapper": name},
    }
    write_policy(tmp_path, network, description, {})
    policy = Ppo(tmp_path)
    seen, _ = wrapped.reset(seed=3)
    observation, info = env.reset(seed=3)
    policy.reset(env, observation, info, np.random.default_rng(0))
    for _ in range(25):
        seen, *_ = wrapped.step(network.predict({name: seen[name] for name in PARTS}, deterministic=True)[0])
        observation, *_, info = env.step(policy.act(observation, info))
        assert np.array_equal(seen["state"], observation["state"])
