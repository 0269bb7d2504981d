"""Recordings far from the origin of their world frame, as in UTM coordinates: labelled near it, and moved back.

Points and classifier features have 32 bits, which at 500 km tell apart 3 cm. So an offset is taken from all poses once,
in 64 bits, before anything is computed.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from labeling.core.episode_labels import EpisodeLabels
from labeling.core.types import Box3d
from labeling.core.views import RgbdViews

STEP_M = 100.0
"""Offsets are multiples of this, so that recordings nearer to the origin than half of it stay where they are."""


def offset_of(views: RgbdViews) -> Float64[np.ndarray, "3"]:
    """What is to be taken from all positions of a recording for its cameras to be near the origin, metres."""
    positions_m = np.asarray(views.camera_to_world, np.float64)[:, :3, 3]
    return STEP_M * np.round(np.median(positions_m, axis=0) / STEP_M)


def moved_views(views: RgbdViews, by_m: Float64[np.ndarray, "3"]) -> RgbdViews:
    """The same views with all cameras moved."""
    poses = np.array(views.camera_to_world, np.float64)
    poses[:, :3, 3] += by_m
    return replace(views, camera_to_world=poses)


def moved_labels(labels: EpisodeLabels, by_m: Float64[np.ndarray, "3"]) -> EpisodeLabels:
    """Labels with 3-D boxes, cloud (of 64 bits then) and refined poses moved."""

    def moved(box: Box3d | None) -> Box3d | None:
        return None if box is None else replace(box, centre_m=box.centre_m + by_m)

    objects = tuple(
        replace(
            one,
            box_3d=moved(one.box_3d),
            places=tuple(replace(place, box_3d=moved(place.box_3d)) for place in one.places),
        )
        for one in labels.objects
    )
    cloud = replace(labels.cloud, points=labels.cloud.points.astype(np.float64) + by_m)
    poses = labels.poses
    if poses is not None and poses.camera_to_world is not None:
        refined = np.array(poses.camera_to_world)
        refined[:, :3, 3] += by_m
        poses = replace(poses, camera_to_world=refined.tolist())
    return replace(labels, objects=objects, cloud=cloud, poses=poses)
