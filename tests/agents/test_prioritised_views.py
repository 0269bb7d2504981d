"""Actions that set priorities: zero is the planner itself, and each priority does what the page says."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.policies.next_best_view import NextBestView
from agents.policies.ppo import Ppo
from agents.ppo.checkpoint import write_policy
from agents.ppo.network import build_policy
from agents.ppo.spaces import describe
from agents.prioritised_views import DRAW_SEED, STRENGTH, PrioritisedViews, priorities_of
from agents.view_planner import Priorities, ViewPlanner
from sbm_gym.object_memory import MemoryConfig

from ..sbm_gym.box_rooms import BoxRooms
from .walled_rooms import WalledRooms

KWARGS = {"net_arch": [8], "features_extractor_kwargs": {"features": 8, "pictures": []}}


def make_env(worlds=None) -> gym.Env:
    # Confirms more than the usual one or two.
    worlds = worlds or BoxRooms()
    return gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=worlds, memory=MemoryConfig(confident=0.4), colours=False)


def moves_of_zero_and(priorities: Priorities, episodes: int):
    """What planners with and without priorities do in the same situations: pairs of world displacements."""
    env = make_env()
    inner = env.unwrapped
    for seed in range(episodes):
        _, info = env.reset(seed=seed)
        plain = ViewPlanner(inner, np.random.default_rng(0))
        for _ in range(25):
            # Both from where it is, with the same places drawn; goals of steps before are forgotten.
            pair = [
                ViewPlanner(inner, np.random.default_rng(0)).act(info, chosen) for chosen in (Priorities(), priorities)
            ]
            yield pair, info
            *_, info = env.step(plain.act(info))


@given(arrays(float, 4, elements=st.floats(-3, 3)))
def test_actions_are_exponents_and_clipped(action):
    told = priorities_of(action)
    values = np.array([told.ahead, told.left, told.explore, told.focus])
    assert np.allclose(values, STRENGTH * np.clip(action, -1, 1))


def test_an_action_of_zero_is_the_next_best_view():
    wrapped, env, policy = PrioritisedViews(make_env()), make_env(), NextBestView()
    for seed in range(2):
        wrapped.reset(seed=seed)
        observation, info = env.reset(seed=seed)
        policy.reset(env, observation, info, np.random.default_rng(DRAW_SEED))
        for _ in range(25):
            *_, there = wrapped.step(np.zeros(4))
            observation, _, _, _, info = env.step(policy.act(observation, info))
            assert np.array_equal(there["agent"]["camera_to_world"], info["agent"]["camera_to_world"])


@pytest.mark.parametrize(("name", "axis"), [("ahead", 0), ("left", 1)])
def test_places_in_a_preferred_direction_are_gone_to(name, axis):
    # Move actions are in the robot's own axes: ahead and left.
    forth, back, shifted = [], [], 0
    for (plain, pulled), _ in moves_of_zero_and(Priorities(**{name: 3.0}), 3):
        forth.append(pulled[axis] - plain[axis])
        shifted += not np.allclose(plain, pulled)
    for (plain, pulled), _ in moves_of_zero_and(Priorities(**{name: -3.0}), 3):
        back.append(pulled[axis] - plain[axis])
    assert shifted > 20
    assert np.mean(forth) > 0.1
    assert np.mean(back) < -0.1


def outcome(worlds, priorities: Priorities) -> tuple[float, float]:
    """Most sides seen of any object, and the share of the floor seen; means over episodes."""
    env, found = make_env(worlds), []
    for seed in range(4):
        _, info = env.reset(seed=seed)
        planner = ViewPlanner(env.unwrapped, np.random.default_rng(seed))
        for _ in range(12):
            *_, info = env.step(planner.act(info, priorities))
        sides = [len(known["azimuths"]) for known in info["confirmed_objects"]]
        found.append((max(sides, default=0), env.unwrapped.episode.floor.seen_share))
    return tuple(np.mean(found, axis=0))


def test_focus_sees_more_sides_and_exploring_more_floor():
    assert outcome(BoxRooms(), Priorities(focus=3.0, explore=-3.0))[0] > outcome(BoxRooms(), Priorities(explore=3.0))[0]
    assert outcome(WalledRooms(), Priorities(explore=3.0))[1] > outcome(WalledRooms(), Priorities(explore=-3.0))[1]


def test_plans_never_bump_into_things_whatever_the_priorities():
    env, rng, bumps = PrioritisedViews(make_env()), np.random.default_rng(1), 0
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(25):
            *_, info = env.step(rng.uniform(-1, 1, 4))
            bumps += info["collided"]
    assert bumps == 0


def test_a_policy_that_sets_priorities_does_as_it_did_in_training(tmp_path):
    env = make_env()
    assert isinstance(env.observation_space, spaces.Dict)
    assert isinstance(env.action_space, spaces.Box)
    network = build_policy(env.observation_space, env.action_space, "MultiInputPolicy", KWARGS)
    for parameter in network.action_net.parameters():
        parameter.data *= 50.0  # new networks hardly act at all
    description = {
        "observation_space": describe(env.observation_space),
        "action_space": describe(env.action_space),
        "policy": {"class": "MultiInputPolicy", "kwargs": KWARGS},
        "hyperparameters": {"env_wrapper": "agents.prioritised_views.PrioritisedViews"},
    }
    write_policy(tmp_path, network, description, {})
    policy, wrapped = Ppo(tmp_path), PrioritisedViews(make_env())
    observation, info = env.reset(seed=3)
    other, _ = wrapped.reset(seed=3)
    policy.reset(env, observation, info, np.random.default_rng(0))
    network.set_training_mode(False)
    moved = 0.0
    for _ in range(12):
        observation, reward, _, _, info = env.step(policy.act(observation, info))
        other, reward_there, _, _, there = wrapped.step(network.predict(other, deterministic=True)[0])
        assert reward == pytest.approx(reward_there)
        assert np.allclose(info["agent"]["position_m"], there["agent"]["position_m"], atol=1e-5)
        moved = info["path_length_m"]
    assert moved > 0.2
