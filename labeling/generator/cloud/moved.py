"""What has moved: surfaces that some views measured and that others look through, in such numbers that no edge and no
noise explains them.

Depth alone tells. Nothing is known of when views were taken but their order, and of that no use is made here.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int

from labeling.core.masks import box_xyxy
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
SETTLED_HITS = 2
"""Views that must have measured what is taken to stand still behind what passes."""
RIM_SHARE = 0.15
"""Depth that other views look through is also kept this far around such a detection, as a share of the square root of
its pixels: masks leave out rims."""


def moved_detections(
    cloud: Cloud, views: RgbdViews, detections: Sequence[Detection]
) -> dict[int, Bool[np.ndarray, "h w"]]:
    """Finds what has moved among what detections show.

    Args:
        cloud: of the views, with all their depth.
        views: those that the cloud was made from.
        detections: of these views.

    Returns:
        By view the pixels of detections of what has moved, and their rims; nothing where nothing has.
    """
    shown = np.zeros(cloud.num_points + 1, bool)  # the last one is for pixels without depth
    for one in detections:
        shown[cloud.voxel_of_pixel[one.view_index][one.mask]] = True
    moved = moved_voxels(cloud, views, np.flatnonzero(shown[:-1]))
    found: dict[int, Bool[np.ndarray, "h w"]] = {}
    for one in detections:
        if shows_moved(cloud, one, moved):
            rim = _with_rim(one.mask)
            found[one.view_index] = found[one.view_index] | rim if one.view_index in found else rim
    return found


def shows_moved(cloud: Cloud, detection: Detection, moved: Bool[np.ndarray, "n"]) -> bool:
    """Whether a detection is of something that has moved.

    Args:
        cloud: of all views.
        detection: of one of them.
        moved: voxels that have moved.
    """
    voxels = cloud.voxel_of_pixel[detection.view_index][detection.mask]
    voxels = voxels[voxels >= 0]
    return len(voxels) >= MIN_PX and bool(np.count_nonzero(moved[voxels]) >= MOVED_SHARE * len(voxels))


def moved_voxels(cloud: Cloud, views: RgbdViews, chosen: Int[np.ndarray, "d"] | None = None) -> Bool[np.ndarray, "n"]:
    """Voxels that enough views look through.

    Args:
        cloud: of the views.
        views: those that the cloud was made from.
        chosen: indices of those that are looked at; all if None.
    """
    chosen = np.arange(cloud.num_points) if chosen is None else chosen
    hits = count_hits(cloud.voxel_of_pixel, cloud.num_points)[chosen]
    misses = count_misses(cloud, views, chosen)
    moved = np.zeros(cloud.num_points, bool)
    moved[chosen] = (misses > 0) & (misses >= MISSES_PER_HIT * hits)
    return moved


def settled_voxels(
    cloud: Cloud, moved: Bool[np.ndarray, "n"], hits: Int[np.ndarray, "n"], first: int, last: int
) -> Bool[np.ndarray, "n"]:
    """Voxels that are no part of a thing that views ``first`` to ``last`` show in passing: what has not moved, and what
    views well before or after have measured as well.

    Args:
        cloud: of all views.
        moved: voxels that have moved.
        hits: how many of all views measured each voxel.
        first: first view that shows the thing.
        last: the last one.
    """
    meanwhile = count_hits(cloud.voxel_of_pixel[max(0, first - 1) : last + 2], cloud.num_points)
    return ~moved & (hits - meanwhile >= SETTLED_HITS)


def _with_rim(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    import cv2

    reach_px = max(2, round(RIM_SHARE * float(np.sqrt(np.count_nonzero(mask)))))
    left, top, right, bottom = map(int, box_xyxy(mask))
    near = slice(max(0, top - reach_px), bottom + reach_px), slice(max(0, left - reach_px), right + reach_px)
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1, 2 * reach_px + 1))
    wider = np.zeros_like(mask)
    wider[near] = cv2.dilate(mask[near].astype(np.uint8), element) > 0
    return wider
