"""Whole episodes with noise."""

from dataclasses import fields, replace

import numpy as np
import pytest

from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.core.geometry import intrinsics_from_fov, look_at
from sbm_gym.sensors.noise_config import SensorNoise
from sbm_gym.sensors.sensor_noise import add_noise


@pytest.fixture
def episode() -> Episode:
    poses = [look_at(np.array([np.cos(a), np.sin(a), 1.0]), np.zeros(3)) for a in range(5)]
    depth_m = np.random.default_rng(0).uniform(1, 3, (5, 24, 32)).astype(np.float32)
    k = np.tile(intrinsics_from_fov(32, 24, 1.2), (5, 1, 1))
    return Episode(np.zeros((5, 24, 32, 3), np.uint8), depth_m, k, np.stack(poses), "", ())


def test_no_noise_is_the_same_episode(episode):
    assert add_noise(episode, SensorNoise(), 3) is episode


def test_noise_depends_on_the_seed_alone(episode):
    noise = SensorNoise("stereo", 2.0, 0.05, 1.0, 0.1)
    first, again, other = (add_noise(episode, noise, seed) for seed in ((3, 1), (3, 1), (3, 2)))
    np.testing.assert_array_equal(first.depth_m, again.depth_m)
    np.testing.assert_array_equal(first.camera_to_world, again.camera_to_world)
    assert not np.array_equal(first.depth_m, other.depth_m)
    assert not np.allclose(first.camera_to_world, other.camera_to_world)


def test_what_settings_have_in_common_is_the_same(episode):
    """So that one adds to the other in a sweep, and rows of a table differ by what their names say."""
    both = add_noise(episode, SensorNoise("kinect", pose_noise_deg=2.0), 5)
    np.testing.assert_array_equal(both.depth_m, add_noise(episode, SensorNoise("kinect"), 5).depth_m)
    turned = add_noise(episode, SensorNoise(pose_noise_deg=2.0), 5)
    np.testing.assert_array_equal(both.camera_to_world, turned.camera_to_world)
    np.testing.assert_array_equal(turned.depth_m, episode.depth_m)
    twice = add_noise(episode, SensorNoise(pose_noise_m=0.2), 5).camera_to_world - episode.camera_to_world
    once = add_noise(episode, SensorNoise(pose_noise_m=0.1), 5).camera_to_world - episode.camera_to_world
    np.testing.assert_allclose(twice, 2 * once, atol=1e-12)


@pytest.mark.parametrize("name", [one.name for one in fields(SensorNoise) if one.name != "sensor"])
def test_negative_errors_are_refused(name):
    with pytest.raises(UsageError, match="must be 0 or more"):
        replace(SensorNoise(), **{name: -0.1}).check()
