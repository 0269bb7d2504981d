"""Every kind of environment that is registered keeps the contracts of Gymnasium and Stable-Baselines3."""

import hashlib
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.passive_env_checker import env_render_passive_checker
from stable_baselines3.common.env_checker import check_env as sb3_check_env

from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.env.viewer_window import screen_available
from sbm_gym.registration import ENV_IDS

IN_SHORT = {"sbm_gym/Indoor-v0", "sbm_gym/OutdoorBuiltin-v0"}
"""One of rooms and one of streets, one with libraries' furniture and one with builtin furniture."""

RENDER_MODES = [mode for mode in FixationEnv.metadata["render_modes"] if mode != "human" or screen_available()]


@pytest.fixture(
    params=[pytest.param(name, marks=() if name in IN_SHORT else pytest.mark.nightly) for name in sorted(ENV_IDS)]
)
def shared_id(request):
    """A kind of env after the other; scenes that were compiled once are opened from disk."""
    return request.param


@pytest.mark.slow
def test_the_checker_of_gymnasium_has_nothing_to_say(shared_id):
    # Warnings are errors in this test suite. The validation split keeps the number of scenes to build small.
    with gym.make(shared_id, split="val", disable_env_checker=True) as made:
        check_env(made.unwrapped, skip_render_check=True)


# One at a time, since the checker keeps the environments of all modes in memory.
@pytest.mark.slow
@pytest.mark.parametrize("mode", RENDER_MODES)
def test_the_checker_has_nothing_to_say_of_any_way_to_render(shared_id, mode):
    with gym.make(shared_id, split="val", render_mode=mode, disable_env_checker=True) as made:
        made.reset(seed=0)
        env_render_passive_checker(made.unwrapped)


@pytest.mark.slow
def test_the_checker_of_sb3_has_nothing_to_say(shared_id):
    sb3_check_env(gym.make(shared_id, split="val"))


@pytest.mark.slow
def test_every_env_gives_the_same_episodes_for_the_same_seed_and_survives_pickling(shared_id):
    def episode(env) -> bytes:
        digest = hashlib.sha256()
        for seed in (7, None):
            observation, info = env.reset(seed=seed)
            digest.update(repr((info["scene"], info["agent"]["position_m"])).encode())
            for action in np.random.default_rng(0).uniform(-1, 1, (4, 4)):
                for name in sorted(observation):
                    digest.update(observation[name].tobytes())
                observation, reward, *_ = env.step(action.astype(np.float32))
                digest.update(repr(reward).encode())
        return digest.digest()

    env = gym.make(shared_id, split="val").unwrapped
    first = episode(env)
    assert episode(env) == first
    assert episode(pickle.loads(pickle.dumps(env))) == first


@pytest.mark.slow
def test_captures_have_the_size_of_the_worlds_profile_and_only_known_classes(shared_id):
    env = gym.make(shared_id, split="val").unwrapped
    env.reset(seed=1)
    capture = env.capture()
    assert capture.rgb.shape[:2] == capture.depth_m.shape == env.profile.capture_size
    assert capture.camera_to_world[2, 3] == pytest.approx(env.profile.body.camera_height_m)
    assert capture.intrinsics[0, 0] == pytest.approx(env.profile.capture_size[1] / 2)  # 90 degrees across
    placed = {instance.instance_id: instance for instance in env.scene.world.objects}
    for label in capture.ground_truth:
        assert label.category == placed[label.instance_id].category
