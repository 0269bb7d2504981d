"""Actions that set priorities: zero is the planner itself, and each priority does what the page says."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from agents.network.checkpoint import write_policy
from agents.network.policy_network import build_policy
from agents.network.spaces import describe
from agents.planning.prioritised_views import ACTION_SPACE, DRAW_SEED, STRENGTH, PrioritisedViews, priorities_of
from agents.planning.view_planner import Priorities, ViewPlanner
from agents.policies.next_best_view import NextBestView
from agents.policies.ppo import Ppo
from sbm_gym.robot.object_memory import MemoryConfig

from ...sbm_gym.box_rooms import BoxRooms
from ..walled_rooms import WalledRooms

KWARGS = {"net_arch": [8], "features_extractor_kwargs": {"features": 8, "pictures": []}}


def make_env(worlds=None) -> gym.Env:
    # Confirms more than the usual one or two.
    worlds = worlds or BoxRooms()
    return gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=worlds, memory=MemoryConfig(confident=0.4), colours=False)


@given(arrays(float, 6, elements=st.floats(-3, 3)))
def test_actions_are_exponents_and_clipped(action):
    told = priorities_of(action)
    values = [told.candidates, told.floor, told.focus, told.detail, told.near, told.patience]
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


def outcome(worlds, priorities: Priorities) -> dict[str, float]:
    """What a planner with priorities has seen after some steps; means over episodes."""
    env, found = make_env(worlds), []
    for seed in range(4):
        _, info = env.reset(seed=seed)
        inner, ranges, goals, targets = env.unwrapped, [], [], []
        planner = ViewPlanner(inner.knowledge, np.random.default_rng(seed))
        for _ in range(15):
            *_, info = env.step(planner.act(info, priorities))
            here = info["agent"]["position_m"]
            if info["fixation_target"]:
                targets.append(info["fixation_target"]["object_id"])
                ranges.append(np.linalg.norm(here - info["fixation_target"]["centroid_m"][:2]))
            if planner.goal_m is not None:
                goals.append(np.linalg.norm(planner.goal_m - here))
        known = inner.knowledge.objects
        found.append(
            {
                "switches": np.count_nonzero(np.diff(targets)),
                "cells": max((len(one.cells) - len(one.azimuths) for one in known), default=0),
                "floor": -float(np.count_nonzero(inner.knowledge.seen_floor.unseen())),
                "range": np.mean(ranges) if ranges else np.nan,
                "goal": np.mean(goals),
            }
        )
    return {name: float(np.nanmean([one[name] for one in found])) for name in found[0]}


@pytest.mark.parametrize(
    ("worlds", "more", "less", "name"),
    [
        (BoxRooms(), Priorities(focus=-3.0), Priorities(focus=3.0), "switches"),
        (WalledRooms(), Priorities(floor=3.0), Priorities(floor=-3.0), "floor"),
        (BoxRooms(), Priorities(detail=3.0, floor=-3.0), Priorities(detail=-3.0, floor=-3.0), "cells"),
        (BoxRooms(), Priorities(near=-2.0), Priorities(near=2.0), "range"),
        (WalledRooms(), Priorities(patience=3.0), Priorities(patience=-3.0), "goal"),
    ],
)
def test_each_priority_gets_more_of_what_it_is_for(worlds, more, less, name):
    assert outcome(worlds, more)[name] > outcome(worlds, less)[name]


def test_doubtful_candidates_are_looked_at_more_if_they_count_more():
    looks = {}
    for candidates in (3.0, -3.0):
        env, count = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=BoxRooms(), colours=False), 0
        for seed in range(4):
            _, info = env.reset(seed=seed)
            planner = ViewPlanner(env.unwrapped.knowledge, np.random.default_rng(seed))
            for _ in range(15):
                *_, info = env.step(planner.act(info, Priorities(candidates=candidates)))
            count += sum(len(one.looks) for one in env.unwrapped.knowledge.view_history.candidates)
        looks[candidates] = count
    assert looks[3.0] > looks[-3.0]


def test_plans_never_bump_into_things_whatever_the_priorities():
    env, rng, bumps = PrioritisedViews(make_env()), np.random.default_rng(1), 0
    for seed in range(3):
        env.reset(seed=seed)
        for _ in range(25):
            *_, info = env.step(rng.uniform(-1, 1, 6))
            bumps += info["collided"]
    assert bumps == 0


def test_a_policy_that_sets_priorities_does_as_it_did_in_training(tmp_path):
    env = make_env()
    assert isinstance(env.observation_space, spaces.Dict)
    network = build_policy(env.observation_space, ACTION_SPACE, "MultiInputPolicy", KWARGS)
    for parameter in network.action_net.parameters():
        parameter.data *= 50.0  # new networks hardly act at all
    description = {
        "observation_space": describe(env.observation_space),
        "action_space": describe(ACTION_SPACE),
        "policy": {"class": "MultiInputPolicy", "kwargs": KWARGS},
        "hyperparameters": {"env_wrapper": "agents.network.prioritised_views.PrioritisedViews"},
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
