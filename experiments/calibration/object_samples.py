"""Observations of candidate objects, with the true category of each, to fit the object model."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Int64

from experiments.calibration.episodes import training_episodes
from labeling.core.episode import Episode
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.find_objects import group_detections, observations_of
from labeling.generator.objects.object_posterior import PlaceObservations
from labeling.generator.propagate import fuse_scene
from labeling.generator.settings.label_config import LabelConfig

OWN_SHARE = 0.5
"""Least share of a candidate's voxels that lie on one true object for the candidate to be of it."""


def object_samples(datasets: Sequence[Path]) -> list[tuple[PlaceObservations, str | None]]:
    """Observations of every candidate object of some datasets, and its true category, None for background."""
    return [sample for episode in training_episodes(datasets, "objects") for sample in _of_episode(episode)]


def _of_episode(episode: Episode) -> list[tuple[PlaceObservations, str | None]]:
    config = LabelConfig(min_posterior=0)
    usable = [one for one in episode.detections or () if np.count_nonzero(one.mask) >= config.min_mask_px]
    scene = fuse_scene(episode, usable, config)
    if scene is None:
        return []
    sure, groups = group_detections(scene.seeds, scene.cloud.num_points, config)
    truths = sorted({(one.instance_id, one.category) for one in episode.ground_truth or ()})
    truth_of_voxel = _instances(scene.cloud, episode, [number for number, _ in truths])
    names = []
    for one in (*sure, *groups):
        voxels = np.bincount(truth_of_voxel[one.foreground_voxels], minlength=len(truths) + 1)
        most = int(voxels[1:].argmax()) if truths else 0
        names.append(truths[most][1] if truths and voxels[1 + most] > OWN_SHARE * voxels.sum() else None)
    return list(zip(observations_of(scene.cloud, scene.eyes_m, sure, groups), names, strict=True))


def _instances(cloud: Cloud, episode: Episode, numbers: Sequence[int]) -> Int64[np.ndarray, "n"]:
    """Which true object most pixels of each voxel show: its place in ``numbers``, counted from 1; 0 for none."""
    shown = np.zeros((episode.num_views, *episode.size), np.int64)
    for one in episode.ground_truth or ():
        shown[one.view_index][one.modal] = 1 + numbers.index(one.instance_id)
    known = cloud.voxel_of_pixel >= 0
    width = len(numbers) + 1
    counts = np.bincount(cloud.voxel_of_pixel[known] * width + shown[known], minlength=cloud.num_points * width)
    return counts.reshape(cloud.num_points, width).argmax(axis=1)
