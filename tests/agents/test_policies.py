"""The hand-written policies do what their pages say, and better than chance."""

import itertools
import shutil
import sys
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.planning.frontiers import Frontiers
from agents.planning.paths import advance, path_length_m, reachable_places
from agents.planning.steering import move_and_look
from agents.policies import registry
from agents.policies.registry import POLICIES, WEIGHTS, make_policy, policy_digest
from agents.policies.ring import _first_direction
from labeling.core.errors import UsageError
from labeling.core.geometry import look_at, unproject_depth
from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.robot.angles import wrap
from sbm_gym.robot.line_of_sight import unhidden
from sbm_gym.robot.object_memory import MemoryConfig, ObjectMemory
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.robot.view_history import ViewHistory
from sbm_gym.worlds.geometry.navigable import navigable_map

from ..sbm_gym.box_rooms import BoxRooms
from .walled_rooms import WalledRooms


def roll_out(name: str, seed: int, worlds: BoxRooms | None = None, watch=None):
    env = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=worlds or BoxRooms())
    observation, info = env.reset(seed=seed)
    policy = make_policy(name)
    policy.reset(env, observation, info, np.random.default_rng(seed))
    steps, truncated = [], False
    while not truncated:
        action = policy.act(observation, info)
        observation, reward, _, truncated, info = env.step(action)
        steps.append((action, reward, info))
        if watch is not None:
            watch(observation, info)
    return steps


def floor_seen(name: str, seed: int) -> int:
    """Quarter metres of floor that a policy's depth images show, counted without anything that policies use."""
    tiles = set()

    def note(observation, info):
        agent = info["agent"]
        points, _ = unproject_depth(0.04 * observation["depth"][..., 0], agent["intrinsics"], agent["camera_to_world"])
        low = points[np.abs(points[:, 2]) < 0.06]
        tiles.update(map(tuple, np.floor(low[:, :2] / 0.25).astype(int).tolist()))

    roll_out(name, seed, WalledRooms(), note)
    return len(tiles)


@pytest.mark.slow
@pytest.mark.parametrize("name", POLICIES)
def test_policies_are_deterministic_and_stay_in_the_action_space(name):
    first, second = roll_out(name, 1), roll_out(name, 1)
    for (action, reward, _), (again, reward_again, _) in zip(first, second, strict=True):
        assert action.dtype == np.float32
        assert np.all(np.abs(action) <= 1.0)
        assert np.array_equal(action, again)
        assert reward == reward_again


def test_unknown_policies_name_the_known_ones():
    with pytest.raises(
        UsageError,
        match="frontier, next_best_view, random, ring, spin, ppo, ppo_evidence, ppo_unmapped, ppo:CHECKPOINT",
    ):
        make_policy("clever")


def test_policies_of_ones_own_go_by_module_and_class():
    policy = make_policy("agents.policies.spin:Spin")
    assert type(policy) is type(make_policy("spin"))
    for name, says in (
        ("agents.policies.spin:Top", "cannot be imported"),
        ("no_such_module:Policy", "cannot be imported"),
        ("collections:OrderedDict", "must be a class with reset and act"),
        ("ring:fast", "unknown policy 'ring:fast'"),
        ("agents.policies.ppo:Ppo", "must be made without arguments"),
        (".x:Y", "cannot be imported"),
    ):
        with pytest.raises(UsageError, match=says):
            make_policy(name)


def test_the_digest_of_a_policy_is_that_of_its_weights(tmp_path):
    env_id = "sbm_gym/Indoor-v0"
    assert policy_digest("ring", env_id) == ""
    run = tmp_path / "run"
    shutil.copytree(WEIGHTS / "Indoor-v0", run)
    shipped = policy_digest("ppo", env_id)
    assert policy_digest(f"ppo:{run}") == shipped
    shutil.rmtree(run)
    shutil.copytree(WEIGHTS / "Indoor-v0-evidence", run)
    assert policy_digest(f"ppo:{run}") == policy_digest("ppo_evidence", env_id) != shipped


def test_ppo_is_the_checkpoint_of_the_env_or_the_one_given(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "agents.policies.ppo", SimpleNamespace(Ppo=lambda path: ("ppo", path)))
    monkeypatch.setattr(registry, "WEIGHTS", tmp_path / "weights")
    shipped = tmp_path / "weights" / "Indoor-v0"
    with pytest.raises(UsageError, match=r"'sbm_gym/Indoor-v0'.*one for: none"):
        make_policy("ppo", "sbm_gym/Indoor-v0")
    shipped.mkdir(parents=True)
    for env_id in ("sbm_gym/Indoor-v0", "sbm_gym/IndoorBuiltin-v0"):
        assert make_policy("ppo", env_id) == ("ppo", shipped)
    assert make_policy(f"ppo:{shipped}") == ("ppo", shipped)
    with pytest.raises(UsageError, match="policy 'ppo_evidence': no trained policy"):
        make_policy("ppo_evidence", "sbm_gym/Indoor-v0")
    other = tmp_path / "weights" / "Indoor-v0-evidence"
    other.mkdir()
    assert make_policy("ppo_evidence", "sbm_gym/IndoorBuiltin-v0") == ("ppo", other)
    with pytest.raises(UsageError, match="one for: Indoor-v0, Indoor-v0-evidence"):
        make_policy("ppo", "sbm_gym/Outdoor-v0")
    with pytest.raises(UsageError, match="no env"):
        make_policy("ppo")
    for missing in ("ppo:", f"ppo:{tmp_path / 'nowhere'}"):
        with pytest.raises(UsageError, match="no such checkpoint"):
            make_policy(missing)


@pytest.mark.slow
def test_ring_spins_until_it_knows_an_object_then_stays_on_its_ring():
    on_ring, circling = 0, 0
    for seed in range(6):
        steps = roll_out("ring", seed)
        # Five turns of 60 degrees; reset's view and theirs are the six of a full turn.
        for (_, _, before), (action, _, _) in itertools.pairwise(steps[:5]):
            if before["fixation_target"]:
                break
            assert np.array_equal(action, [0.0, 0.0, 1.0, 0.0])
        for action, _, info in steps[12:]:
            if info["fixation_target"] and not np.any(action[2:]):
                offset = info["fixation_target"]["centroid_m"][:2] - info["agent"]["position_m"]
                circling += 1
                on_ring += 0.8 <= np.linalg.norm(offset) <= 2.2
    assert circling > 40
    assert on_ring / circling > 0.75


@pytest.mark.slow
def test_ring_and_next_best_view_see_more_sides_than_random_and_never_bump_into_things():
    sectors, bumps = {}, {}
    for name in ("ring", "next_best_view", "random"):
        ends = [roll_out(name, seed) for seed in range(4)]
        sectors[name] = np.mean([sum(len(o["azimuths"]) for o in steps[-1][2]["confirmed_objects"]) for steps in ends])
        bumps[name] = sum(info["collided"] for steps in ends for *_, info in steps)
    for name in ("ring", "next_best_view"):
        assert sectors[name] > 1.5 * sectors["random"]
        assert bumps[name] <= 0.1 * bumps["random"]


@pytest.mark.slow
def test_a_planner_gets_more_of_what_it_values():
    def earned(goal: str) -> dict[str, float]:
        terms = [info["reward_terms"] for seed in range(4) for *_, info in roll_out(f"next_best_view:{goal}", seed)]
        return {name: sum(one[name] for one in terms) for name in ("discovery", "diversity")}

    both, discovery, diversity, neither = map(earned, ("both", "discovery", "diversity", "neither"))
    assert discovery["diversity"] < 0.7 * min(both["diversity"], diversity["diversity"])
    assert neither["diversity"] < 0.7 * both["diversity"]
    with pytest.raises(UsageError, match="one of both, discovery, diversity, neither"):
        make_policy("next_best_view:glory")


def test_spin_turns_all_the_way_round_on_the_spot():
    turned = 0
    for seed in range(3):
        steps = roll_out("spin", seed)
        places = np.array([info["agent"]["position_m"] for *_, info in steps])
        assert np.ptp(places, axis=0).max() < 1e-3
        for (_, _, before), (_, _, after) in itertools.pairwise(steps):
            turn = wrap(after["agent"]["yaw_rad"] - before["agent"]["yaw_rad"])
            assert turn == pytest.approx(np.deg2rad(60.0), abs=1e-3)
            turned += 1
    assert turned > 60


@pytest.mark.slow
def test_frontier_sees_more_floor_than_spin_and_random_where_walls_hide_it():
    floors = {name: sum(floor_seen(name, seed) for seed in range(3)) for name in ("frontier", "random", "spin")}
    assert floors["frontier"] > 1.15 * floors["random"]
    assert floors["frontier"] > 1.5 * floors["spin"]


def test_advance_takes_strides_around_obstacles_to_the_goal():
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), np.array([[0.0, 0.0, 0.1, 2.0, 0.0]]))
    position, goal = np.array([-1.0, 0.0]), np.array([1.0, 0.3])
    length = path_length_m(room, position, goal)
    assert length > 4.0
    strides = 0
    while np.linalg.norm(goal - position) > 1e-6:
        step = advance(room, position, goal, 0.5)
        assert step is not None
        assert np.linalg.norm(step) <= 0.5 + 1e-9
        assert room.line_is_free(position, position + step)
        position = position + step
        strides += 1
        assert strides < 20
    assert strides <= length / 0.5 + 4


def test_advance_knows_when_there_is_no_way():
    wall = np.array([[0.0, 0.0, 0.1, 4.0, 0.0]])
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), wall)
    assert advance(room, np.array([-1.0, 0.0]), np.array([1.0, 0.0]), 0.5) is None
    assert path_length_m(room, np.array([-1.0, 0.0]), np.array([1.0, 0.0])) == float("inf")


def test_seen_walls_block_the_line_of_sight_and_unseen_space_does_not():
    seen = SeenSpace(np.array([-3.0, -3.0]), np.array([3.0, 3.0]))
    eyes, target = np.array([[2.0, 0.0, 1.5], [-2.0, 0.0, 1.5]]), np.array([0.0, 0.0, 0.5])
    assert np.all(seen.sees(eyes, target, 0.3))
    # A wall at x = 1, seen from the origin.
    pose = look_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]))
    seen.add(np.ones((60, 60), np.float32), Camera.from_fov(pose, (60, 60), np.pi / 2))
    assert seen.sees(eyes, target, 0.3).tolist() == [False, True]


@given(st.integers(0, 2**32 - 1))
def test_lines_of_sight_end_at_the_first_filled_cell(seed):
    rng = np.random.default_rng(seed)
    filled = rng.random((12, 9, 7)) < 0.05
    origin, cell = rng.uniform(-1, 1, 3), float(rng.uniform(0.1, 0.4))
    corner = origin + cell * np.array(filled.shape)
    target, eyes = rng.uniform(origin, corner), rng.uniform(origin - 0.5, corner + 0.5, (20, 3))
    short, clear = float(rng.uniform(0.1, 0.6)), 0.2
    told = unhidden(filled, origin, cell, eyes, target, short, clear)
    for eye, free in zip(eyes, told, strict=True):
        distance = np.linalg.norm(eye - target)
        along = np.arange(short, 10.0, 0.5 * cell)
        points = target + along[along < distance - clear, None] * (eye - target) / distance
        cells = np.floor((points - origin) / cell).astype(int)
        cells = cells[np.all((cells >= 0) & (cells < filled.shape), axis=1)]
        assert free == (not filled[tuple(cells.T)].any())


def is_unseen(floor: SeenFloor, place) -> bool:
    return bool(floor.unseen()[floor.cell(place)])


def seen_share(floor: SeenFloor) -> float:
    return 1.0 - np.count_nonzero(floor.unseen()) / np.count_nonzero(floor.is_floor)


def test_seen_floor_is_what_depth_shows_and_not_what_walls_hide():
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), np.array([[1.0, 0.0, 0.05, 2.0, 0.0]]))
    floor = SeenFloor(room, np.array([-2.0, 0.0]), 0.5, 8.0)
    before = seen_share(floor)
    # An eye 1.5 m high at x = -2 that looks level along +X at a floor of its own, and at a wall at x = 1.
    pose = look_at(np.array([-2.0, 0.0, 1.5]), np.array([0.0, 0.0, 1.5]))
    camera = Camera.from_fov(pose, (64, 64), np.pi / 2)
    rows = (np.arange(64) - camera.intrinsics[1, 2]) / camera.intrinsics[1, 1]
    to_floor = np.where(rows > 0, 1.5 / np.maximum(rows, 1e-9), np.inf)
    depth = np.repeat(np.minimum(to_floor, 3.0)[:, None], 64, axis=1).astype(np.float32)
    floor.add(depth, camera)
    assert seen_share(floor) > before
    assert not is_unseen(floor, np.array([0.2, 0.0]))
    assert is_unseen(floor, np.array([2.0, 0.0]))
    assert is_unseen(floor, np.array([-2.0, 2.5]))
    frontiers = Frontiers(floor)
    places = [frontier.place_m for frontier in frontiers.remaining()]
    assert places
    assert all(is_unseen(floor, place) and frontiers.is_open(place) for place in places)
    frontiers.note_failed_look(places[0])
    assert frontiers.is_open(places[0])
    frontiers.note_failed_look(places[0])
    assert not frontiers.is_open(places[0])
    # Giving up on a place is no news about the floor.
    assert is_unseen(floor, places[0])


def test_starting_over_counts_what_is_seen_from_then_on():
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), np.zeros((0, 5)))
    floor = SeenFloor(room, np.array([0.0, 0.0]), 0.5, 8.0)
    frontiers, eye = Frontiers(floor), np.array([-1.0, 0.0, 1.5])
    down, up = (
        Camera.from_fov(look_at(eye, np.array([1.0, 0.0, height])), (64, 64), np.pi / 2) for height in (0.0, 3.0)
    )
    far = np.full((64, 64), 7.0, np.float32)
    floor.add(far, down)
    ahead = np.array([1.0, 0.0])
    assert not frontiers.is_open(ahead)
    share = seen_share(floor)
    frontiers.start_over()
    assert frontiers.is_open(ahead)
    assert seen_share(floor) == share
    floor.add(far, up)
    assert frontiers.is_open(ahead)
    floor.add(far, down)
    assert not frontiers.is_open(ahead)


def test_reachable_places_are_free_and_as_far_as_the_shortest_way():
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), np.array([[0.0, 0.0, 0.1, 2.0, 0.0]]))
    start = np.array([-1.0, 0.3])
    places, lengths = reachable_places(room, start, 0.5, 4.0)
    assert np.array_equal(places[0], start)
    assert all(room.is_free(place) for place in places)
    assert lengths.max() <= 4.0
    assert np.linalg.norm(places - start, axis=1).max() > 3.0
    for place, way in list(zip(places, lengths, strict=True))[::97]:
        shortest = path_length_m(room, start, place)
        assert 0.93 * shortest - 0.1 <= way <= 1.09 * shortest + 0.1
    # Just behind the wall is near by air and far on foot: out of reach.
    assert np.linalg.norm(places - np.array([1.0, 0.3]), axis=1).min() > 0.5


def test_look_points_the_camera_where_it_was_told():
    env = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=BoxRooms())
    rng, exact = np.random.default_rng(0), 0
    for seed in range(3):
        _, info = env.reset(seed=seed)
        for _ in range(25):
            objects = info["confirmed_objects"]
            wanted = rng.uniform(-np.pi, np.pi)
            before = info["agent"]["yaw_rad"]
            step = rng.uniform(-0.1, 0.1, 2)
            _, _, _, _, info = env.step(move_and_look(info, env.unwrapped.knowledge.stride_m, step, wanted, -0.3))
            if info["collided"]:
                continue
            miss = abs(wrap(info["agent"]["yaw_rad"] - wanted))
            # Without a fixation target it turns by at most 60 degrees.
            least = 0.0 if objects else max(0.0, abs(wrap(wanted - before)) - np.pi / 3)
            assert miss == pytest.approx(least, abs=0.02)
            exact += least == 0.0
    assert exact > 10


def test_unseen_floor_around_a_place_is_counted_by_ring_and_direction():
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), np.array([[0.0, 1.0, 0.1, 1.5, 0.0]]))
    floor = SeenFloor(room, np.array([-2.0, 0.0]), 0.5, 8.0)
    pose = look_at(np.array([-2.0, 0.0, 1.5]), np.array([-1.0, 0.5, 0.0]))
    floor.add(np.full((60, 60), 2.0, np.float32), Camera.from_fov(pose, (60, 60), np.pi / 2))
    place, yaw, rings = np.array([-1.5, -0.5]), 0.4, ((0.0, 3.0), (3.0, 12.0))
    shares = floor.unseen_around(place, yaw, rings, 8)
    # By brute force, with points in place of the grid's cells.
    xy = np.random.default_rng(0).uniform(-3, 3, (20_000, 2))
    unseen = np.array([point for point in xy if room.is_free(point) and is_unseen(floor, point)])
    offsets = unseen - place
    strides, angles = np.hypot(*offsets.T) / 0.5, np.arctan2(offsets[:, 1], offsets[:, 0]) - yaw
    for ring, (low, high) in enumerate(rings):
        for k in range(8):
            inside = (strides >= low) & (strides < high) & (np.abs(wrap(angles - k * np.pi / 4)) < np.pi / 8)
            area = np.count_nonzero(inside) * 36 / len(xy)
            whole = np.pi * (high**2 - low**2) * 0.25 / 8
            assert shares[ring, k] == pytest.approx(area / whole, abs=0.12 if ring == 0 else 0.03)
    assert shares.max() > 0.3
    assert (shares < 0.05).any()


def test_looked_at_keeps_candidates_until_they_are_confirmed():
    config = MemoryConfig()
    looked, memory = ViewHistory(config), ObjectMemory(config)
    pose = look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 0.5]))
    camera = Camera.from_fov(pose, (80, 80), 1.57)
    depth = np.full((80, 80), 2.0, np.float32)
    mask = np.zeros((80, 80), bool)
    mask[30:50, 30:50] = True
    for confidence in (0.4, 0.6, 0.5):
        update = memory.observe([Detection(0, "chair", confidence, mask)], depth, camera)
        looked.add(update.unconfirmed, memory.objects, pose)
    assert [one.confidence for one in looked.candidates] == [0.6]
    assert len(looked.candidates[0].looks) == 1
    sure = [Detection(0, "chair", 0.95, mask)]
    looked.add(memory.observe(sure, depth, camera).unconfirmed, memory.objects, pose)
    assert looked.candidates == []
    assert looked.tried(0) == memory.objects[0].cells


@pytest.mark.parametrize(
    ("left", "here", "steps", "expected"),
    [
        ([1, 2, 3], 0, 10, 1),
        ([15, 16, 17], 0, 10, -1),
        # A short arm one way and a long one the other: the short one first if there is time for both ...
        ([1, 2, 13, 14, 15, 16, 17], 0, 25, 1),
        # ... the long one first if there is not.
        ([1, 2, 13, 14, 15, 16, 17], 0, 5, -1),
    ],
)
def test_the_first_direction_sees_most_in_the_time_left(left, here, steps, expected):
    assert _first_direction(left, here, 18, steps) == expected


@pytest.mark.slow
def test_policies_go_with_detectors_that_look_at_pictures_of_their_own():
    env = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=BoxRooms(), detector="compact", detector_size=(128, 128))
    for name in POLICIES:
        observation, info = env.reset(seed=2)
        policy = make_policy(name)
        policy.reset(env, observation, info, np.random.default_rng(0))
        for _ in range(4):
            observation, _, _, _, info = env.step(policy.act(observation, info))
            masks = [detection.mask.shape for detection in info["detections"]]
            assert set(masks) <= {info["sight"]["depth_m"].shape} == {(128, 128)}
