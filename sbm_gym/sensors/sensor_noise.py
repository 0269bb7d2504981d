"""An episode as a real sensor would have recorded it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labeling.core.episode import Episode
from sbm_gym.sensors.depth_noise import sense_depth
from sbm_gym.sensors.noise_config import SensorNoise
from sbm_gym.sensors.pose_noise import drift_poses, jitter_poses


def add_noise(episode: Episode, noise: SensorNoise, seed: int | Sequence[int]) -> Episode:
    """An episode with noisy depth and poses; pictures, detections and masks stay as they are.

    Args:
        episode: without noise.
        noise: of which kind.
        seed: decides the noise. Poses and each view's depth have generators of their own, so that of two settings with
            one seed what they have in common is the same.

    Returns:
        The same episode where there is no noise.
    """
    if noise == SensorNoise():
        return episode
    jitter, drift, *views = (np.random.default_rng(one) for one in _seeds(seed, 2 + episode.num_views))
    poses = jitter_poses(episode.camera_to_world, np.deg2rad(noise.pose_noise_deg), noise.pose_noise_m, jitter)
    poses = drift_poses(poses, np.deg2rad(noise.pose_drift_deg), noise.pose_drift_m, drift)
    sensed = [
        sense_depth(noise.sensor, depth_m, intrinsics, rng)
        for depth_m, intrinsics, rng in zip(episode.depth_m, episode.intrinsics, views, strict=True)
    ]
    return replace(episode, depth_m=np.stack(sensed), camera_to_world=poses)


def _seeds(seed: int | Sequence[int], count: int) -> list[np.random.SeedSequence]:
    return np.random.SeedSequence(seed).spawn(count)
