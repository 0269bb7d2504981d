"""From where to look at a labelled scene, and what to leave out so that something is seen: pure geometry."""

import numpy as np
from jaxtyping import Bool, Float

from labeling.inspection.scene import LabelledScene

ABOVE = 0.1
"""How far above the objects the scene is shown, as a share of the longest edge of the region they take up."""
OPENING_ELEVATION_RAD = 0.9
SURE = 0.2
"""Confidence from which on an object has a say in what is looked at: one that is not there may be in the ceiling."""
MIN_SPACING_M = 1e-3


def region(scene: LabelledScene) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Centre and extent of what to look at, metres: the objects that are sure, all if none is, or the whole cloud."""
    if scene.objects:
        sure = [one for one in scene.objects if one.confidence >= SURE] or scene.objects
        corners = np.concatenate([one.box.corners() for one in sure])
    elif len(scene.points):
        corners = np.quantile(scene.points, [0.02, 0.98], axis=0)
    else:
        corners = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return 0.5 * (low + high), np.maximum(high - low, 1e-3)


def cut_height_m(scene: LabelledScene) -> float:
    """The height, world z, above which a ceiling would hide everything: a little above the objects and all cameras."""
    centre, size_m = region(scene)
    top = centre[2] + 0.5 * size_m[2] + ABOVE * size_m.max()
    return float(max([top, *(camera.camera_to_world[2, 3] for camera in scene.cameras)]))


def below(scene: LabelledScene, height_m: float) -> Bool[np.ndarray, "n"]:
    """Points that are not above a height, and all points of objects."""
    return (scene.labels > 0) | (scene.points[:, 2] <= height_m)


def opening_view(scene: LabelledScene, fov_rad: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Where to look from and at, world metres: from the side of the cameras, high enough to see over walls.

    Args:
        scene: to look at.
        fov_rad: the smaller field of view of the window; the boxes of all sure objects are in it.
    """
    centre, size_m = region(scene)
    azimuth = first_azimuth(scene, centre)
    flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    direction = np.cos(OPENING_ELEVATION_RAD) * flat + [0, 0, np.sin(OPENING_ELEVATION_RAD)]
    # The ball around the region touches the edges of the picture.
    return centre + 0.5 * float(np.linalg.norm(size_m)) / np.sin(0.5 * fov_rad) * direction, centre


def first_azimuth(scene: LabelledScene, centre: Float[np.ndarray, "3"]) -> float:
    """The direction that most cameras looked from, radians about +Z, so that what they saw is seen."""
    if not scene.cameras:
        return -np.pi / 2
    offset = np.mean([camera.camera_to_world[:2, 3] for camera in scene.cameras], axis=0) - centre[:2]
    return float(np.arctan2(offset[1], offset[0])) if np.linalg.norm(offset) > 1e-6 else -np.pi / 2


def spacing_m(points: Float[np.ndarray, "n 3"]) -> float:
    """Distance between neighbouring points, metres, a little more, so that surfaces close up."""
    if len(points) < 2:
        return 0.01
    from scipy.spatial import cKDTree

    some = points[:: max(1, len(points) // 2000)]
    return max(MIN_SPACING_M, float(np.median(cKDTree(points).query(some, k=2)[0][:, 1])) * 1.6)
