"""The hand-written policy does what the thesis says, and better than chance."""

import itertools

import gymnasium as gym
import numpy as np
import pytest

from agents.paths import advance, way_length_m
from agents.policies.registry import POLICIES, make_policy
from agents.policies.ring import _first_direction
from agents.seen_space import SeenSpace
from labeling.errors import UsageError
from labeling.geometry import intrinsics_from_fov, look_at
from sbm_gym.worlds.navigable import navigable_map

from ..sbm_gym.box_rooms import BoxRooms


def roll_out(name: str, seed: int):
    env = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=BoxRooms())
    observation, info = env.reset(seed=seed)
    policy = make_policy(name)
    policy.reset(env, observation, info, np.random.default_rng(seed))
    steps, truncated = [], False
    while not truncated:
        action = policy.act(observation, info)
        observation, reward, _, truncated, info = env.step(action)
        steps.append((action, reward, info))
    return steps


@pytest.mark.parametrize("name", POLICIES)
def test_policies_are_deterministic_and_stay_in_the_action_space(name):
    first, second = roll_out(name, 1), roll_out(name, 1)
    for (action, reward, _), (again, reward_again, _) in zip(first, second, strict=True):
        assert action.dtype == np.float32
        assert np.all(np.abs(action) <= 1.0)
        assert np.array_equal(action, again)
        assert reward == reward_again


def test_unknown_policies_name_the_known_ones():
    with pytest.raises(UsageError, match="random, ring"):
        make_policy("ppo")


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


def test_ring_sees_more_sides_than_random_and_never_bumps_into_things():
    sectors, bumps = {}, {}
    for name in POLICIES:
        ends = [roll_out(name, seed) for seed in range(8)]
        sectors[name] = np.mean([sum(len(o["azimuths"]) for o in steps[-1][2]["confirmed_objects"]) for steps in ends])
        bumps[name] = sum(info["collided"] for steps in ends for *_, info in steps)
    assert sectors["ring"] > 1.5 * sectors["random"]
    assert bumps["ring"] <= 0.1 * bumps["random"]


def test_advance_takes_strides_around_obstacles_to_the_goal():
    room = navigable_map(np.array([-3.0, -3.0]), np.array([3.0, 3.0]), np.array([[0.0, 0.0, 0.1, 2.0, 0.0]]))
    position, goal = np.array([-1.0, 0.0]), np.array([1.0, 0.3])
    length = way_length_m(room, position, goal)
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
    assert way_length_m(room, np.array([-1.0, 0.0]), np.array([1.0, 0.0])) == float("inf")


def test_seen_walls_block_the_line_of_sight_and_unseen_space_does_not():
    seen = SeenSpace(np.array([-3.0, -3.0]), np.array([3.0, 3.0]))
    eyes, target = np.array([[2.0, 0.0, 1.5], [-2.0, 0.0, 1.5]]), np.array([0.0, 0.0, 0.5])
    assert np.all(seen.sees(eyes, target, 0.3))
    # A wall at x = 1, seen from the origin.
    pose = look_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]))
    seen.add(np.ones((60, 60), np.float32), intrinsics_from_fov(60, 60, np.pi / 2), pose)
    assert seen.sees(eyes, target, 0.3).tolist() == [False, True]


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
