"""What has moved: surfaces that some views measured and that others look through, in such numbers that no edge and no
noise explains them.

Depth alone tells. Nothing is known of when views were taken but their order, and of that no use is made here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.cloud.free_space import count_hits, count_misses
from labeling.generator.cloud.voxel_cloud import Cloud

MISSES_PER_HIT = 0.5
"""A voxel may have moved if so many views look through it, for each that measured it, and one at least does."""
MOVED_SHARE = 0.35
"""A detection is of something that moved if this share of its pixels with depth shows such voxels. In rooms without
motion, recorded without noise, the highest share of any visible object was .05; with the noise of a Kinect and poses
1 degree and 2 cm off 1 % of them had more than .5."""
MIN_PX = 64
"""Detections with fewer pixels with depth tell nothing."""
RIM_SHARE = 0.15
"""Depth that other views look through is also kept this far around such a detection, as a share of the square root of
its pixels: masks leave out rims."""


@dataclass(frozen=True)
class Moved:
    """What has moved in an episode."""

    voxels: Bool[np.ndarray, "n"]
    """Voxels of the cloud that have, as far as detections show them."""
    kept: dict[int, Bool[np.ndarray, "h w"]]
    """By view: pixels of detections of what has moved, and their rims."""


def find_moved(cloud: Cloud, views: RgbdViews, detections: Sequence[Detection]) -> Moved | None:
    """Finds what has moved among what detections show.

    Args:
        cloud: of the views, with all their depth.
        views: those that the cloud was made from.
        detections: of these views.

    Returns:
        None if no detection is of something that has moved.
    """
    voxels = moved_voxels(cloud, views, detections)
    kept: dict[int, Bool[np.ndarray, "h w"]] = {}
    for one in detections:
        shown = cloud.voxel_of_pixel[one.view_index][one.mask]
        shown = shown[shown >= 0]
        if len(shown) >= MIN_PX and np.count_nonzero(voxels[shown]) >= MOVED_SHARE * len(shown):
            rim = _with_rim(one.mask)
            kept[one.view_index] = kept[one.view_index] | rim if one.view_index in kept else rim
    return Moved(voxels, kept) if kept else None


def moved_voxels(cloud: Cloud, views: RgbdViews, detections: Sequence[Detection]) -> Bool[np.ndarray, "n"]:
    """Voxels that enough views look through, among those that detections show; arguments as of ``find_moved``."""
    shown = np.zeros(cloud.num_points + 1, bool)  # the last one is for pixels without depth
    for one in detections:
        shown[cloud.voxel_of_pixel[one.view_index][one.mask]] = True
    chosen = np.flatnonzero(shown[:-1])
    hits = count_hits(cloud.voxel_of_pixel, cloud.num_points)[chosen]
    misses = count_misses(cloud, views, chosen)
    moved = np.zeros(cloud.num_points, bool)
    moved[chosen] = (misses > 0) & (misses >= MISSES_PER_HIT * hits)
    return moved


def _with_rim(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    import cv2

    reach_px = max(2, round(RIM_SHARE * float(np.sqrt(np.count_nonzero(mask)))))
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1, 2 * reach_px + 1))
    return cv2.dilate(mask.astype(np.uint8), element) > 0
