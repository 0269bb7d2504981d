"""Actions that name places: they mean what the page says, and lead there without bumping into things."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from hypothesis import given
from hypothesis import strategies as st

from agents.policies.ppo import Ppo
from agents.ppo.checkpoint import write_policy
from agents.ppo.network import build_policy
from agents.ppo.spaces import describe
from agents.steering import wrap
from agents.waypoints import Waypoints, around_rad, next_side, place_m, sectors_left, towards
from sbm_gym.object_memory import MemoryConfig

from ..sbm_gym.box_rooms import BoxRooms

KWARGS = {"net_arch": [8], "features_extractor_kwargs": {"features": 8, "pictures": []}}


def make_env() -> gym.Env:
    # Confirms more than the usual one or two.
    return gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=BoxRooms(), memory=MemoryConfig(confident=0.4), colours=False)


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_turns_around_the_target_grow_with_the_action_and_have_no_side(one, other):
    assert around_rad(-one) == pytest.approx(-around_rad(one))
    assert abs(around_rad(one)) <= np.deg2rad(150) + 1e-9
    if one < other:
        assert around_rad(one) <= around_rad(other)


def test_places_are_at_the_distance_and_the_angle_from_the_next_side_that_were_asked_for():
    env, rng, told = make_env(), np.random.default_rng(0), {True: 0, False: 0}
    for seed in range(4):
        _, info = env.reset(seed=seed)
        for _ in range(25):
            action = rng.uniform(-1, 1, 4)
            agent, had_target = info["agent"], bool(info["fixation_target"])
            place, pose = place_m(env.unwrapped, info, action), info["agent"]["camera_to_world"]
            told[had_target] += 1
            if had_target:
                known, angle = next_side(env.unwrapped, agent["position_m"])
                assert known is env.unwrapped.episode.target
                away = place - known.centroid_m[:2]
                assert np.linalg.norm(away) == pytest.approx(0.75 + 0.5 * (action[0] + 1) * 1.75)
                turned = wrap(angle - np.arctan2(*away[::-1]))
                assert turned == pytest.approx(around_rad(action[1]), abs=1e-6)
            else:
                # Camera axes: +Z ahead, +X to the right; the tilt is taken out.
                ahead = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
                expected = 3.0 * (action[0] * ahead - action[1] * pose[:2, 0])
                assert np.allclose(place - agent["position_m"], expected, atol=1e-6)
            *_, info = env.step(rng.uniform(-1, 1, 4))
    assert min(told.values()) > 5


def test_the_next_side_is_the_nearest_one_that_is_open_and_new():
    env, rng, told, changed = make_env(), np.random.default_rng(2), 0, 0
    inner = env.unwrapped
    for seed in range(4):
        _, info = env.reset(seed=seed)
        for _ in range(25):
            if info["fixation_target"]:
                here, before = info["agent"]["position_m"], inner.episode.target
                known, angle = next_side(inner, here)
                left = {one.object_id: sectors_left(inner, one) for one in inner.memory.objects}
                if left[before.object_id]:
                    assert known is before
                elif any(left.values()):
                    assert left[known.object_id]
                    assert inner.episode.target is known
                    changed += 1
                if left[known.object_id]:
                    sector = inner.azimuth_bin(angle)
                    is_open = inner.episode.open_sectors(known)
                    assert is_open[sector]
                    assert sector not in known.azimuths
                    from_here = np.arctan2(*(here - known.centroid_m[:2])[::-1])
                    nearer = [abs(wrap(np.deg2rad(20 * s + 10) - from_here)) for s in left[known.object_id]]
                    assert abs(wrap(angle - from_here)) == pytest.approx(min(nearer))
                    told += 1
            *_, info = env.step(towards(inner, info, rng.uniform(-0.5, 0.5, 4)))
    assert told > 30
    assert changed > 0


def test_an_action_of_zero_circles_what_it_finds_and_bumps_into_nothing():
    env = Waypoints(make_env())
    seen, bumps = [], 0
    for seed in range(4):
        _, info = env.reset(seed=seed)
        for _ in range(25):
            *_, info = env.step(np.zeros(4) if info["fixation_target"] else np.array([0, 0, 1, 0]))
            bumps += info["collided"]
        seen.append(max((len(known["azimuths"]) for known in info["confirmed_objects"]), default=0))
    assert bumps == 0
    assert np.mean(seen) > 9


def test_every_place_leads_to_a_move_of_a_stride_at_most():
    env, rng = make_env(), np.random.default_rng(1)
    for seed in range(3):
        _, info = env.reset(seed=seed)
        for _ in range(25):
            chosen = rng.uniform(-3, 3, 4)
            action = towards(env.unwrapped, info, chosen)
            assert np.all(np.abs(action) <= 1.0)
            assert np.linalg.norm(action[:2]) <= 1.0 + 1e-6
            gaze = np.clip(chosen[2:], -1, 1)
            assert np.allclose(action[2:], [np.sign(gaze[0]) * gaze[0] ** 2, 0.4 * gaze[1]])
            *_, info = env.step(action)
            assert not info["collided"]


def test_a_policy_that_names_places_does_as_it_did_in_training(tmp_path):
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
        "hyperparameters": {"env_wrapper": "agents.waypoints.Waypoints"},
    }
    write_policy(tmp_path, network, description, {})
    policy, wrapped = Ppo(tmp_path), Waypoints(make_env())
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
