"""Regions to ignore: they may be objects although none could be confirmed, so nobody should learn background there.

A detector misses most objects in most views, and finds in one view, at low confidence, what it misses in another.
Detections that no label explains add up over views at the points of the cloud, and where they reach a threshold, every
view marks a region to be ignored.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float32, Int64
from numba import njit

from labeling.core.episode_labels import IgnoredRegion
from labeling.core.types import Detection, PseudoLabel
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.settings.label_config import LabelConfig

EXPLAINED_SHARE = 0.5
"""Share of a detection that labels must cover to explain it."""
MIN_CONFIDENCE = 0.05
"""Detections less confident than this are left out: a detector has some of them everywhere."""


def unconfirmed_regions(
    cloud: Cloud, detections: Sequence[Detection], labels: Sequence[PseudoLabel], config: LabelConfig
) -> list[IgnoredRegion]:
    """Regions in which detections that no label explains add up to ``config.ignore_unconfirmed`` or more.

    Args:
        cloud: the points of all views; it may have none.
        detections: of all views.
        labels: of all views.
        config: settings.

    Returns:
        One for each connected region of a view and category; regions of fewer pixels than ``config.min_mask_px`` are
        left out.
    """
    labelled = _labelled(labels)
    unexplained = list(_unexplained_detections(detections, labelled))
    threshold = config.ignore_unconfirmed
    drawn: dict[tuple[int, str], Bool[np.ndarray, "h w"]] = {}
    sure: dict[tuple[int, str], float] = {}

    def draw(view: int, category: str, mask: Bool[np.ndarray, "h w"], confidence: float) -> None:
        place = view, category
        drawn[place] = drawn[place] | mask if place in drawn else mask
        sure[place] = max(sure.get(place, 0.0), min(1.0, confidence))

    for one, rest in unexplained:
        if one.confidence >= threshold:
            draw(one.view_index, one.category, rest, one.confidence)
    if config.doubt_across_views and unexplained:
        names = sorted({one.category for one, _ in unexplained})
        support, category = _summed_confidence(cloud, unexplained, names)
        number = np.where(support >= threshold, category, -1).astype(np.int32)
        nothing = np.zeros(cloud.voxel_of_pixel.shape[1:], bool)
        for view, voxels in enumerate(cloud.voxel_of_pixel):
            shown, highest = _shown(voxels, labelled.get(view, nothing), number, support, len(names))
            for name in np.flatnonzero(highest > 0):
                draw(view, names[name], shown == name, float(highest[name]))
    return [
        IgnoredRegion(view, category, sure[view, category], region)
        for (view, category), mask in sorted(drawn.items())
        for region in _connected_components(mask, max(1, config.min_mask_px))
    ]


def _labelled(labels: Sequence[PseudoLabel]) -> dict[int, Bool[np.ndarray, "h w"]]:
    """The union of the labels of each view that has any."""
    found: dict[int, Bool[np.ndarray, "h w"]] = {}
    for one in labels:
        found[one.view_index] = found[one.view_index] | one.modal if one.view_index in found else one.modal
    return found


def _unexplained_detections(
    detections: Sequence[Detection], labelled: dict[int, Bool[np.ndarray, "h w"]]
) -> Iterator[tuple[Detection, Bool[np.ndarray, "h w"]]]:
    """Detections that labels do not explain, and what labels leave of them."""
    for one in detections:
        if one.confidence < MIN_CONFIDENCE:
            continue
        rest = one.mask & ~labelled[one.view_index] if one.view_index in labelled else one.mask
        left = np.count_nonzero(rest)
        if left and left > (1 - EXPLAINED_SHARE) * np.count_nonzero(one.mask):
            yield one, rest


def _summed_confidence(
    cloud: Cloud, unexplained: Sequence[tuple[Detection, Bool[np.ndarray, "h w"]]], names: Sequence[str]
) -> tuple[Float32[np.ndarray, "n"], Int64[np.ndarray, "n"]]:
    """For every voxel the sum over views of the highest confidence there, and the category with the highest sum."""
    total = np.zeros(cloud.num_points, np.float32)
    of_name = np.zeros((len(names), cloud.num_points), np.float32)
    for view in sorted({one.view_index for one, _ in unexplained}):
        highest = np.zeros(cloud.num_points, np.float32)
        for one, rest in unexplained:
            if one.view_index != view:
                continue
            voxels = np.unique(cloud.voxel_of_pixel[view][rest])
            voxels = voxels[voxels >= 0]
            highest[voxels] = np.maximum(highest[voxels], np.float32(one.confidence))
            of_name[names.index(one.category), voxels] += np.float32(one.confidence)
        total += highest
    return total, of_name.argmax(axis=0)


@njit(cache=True, nogil=True)
def _shown(voxels, labelled, number, support, num_names):  # pragma: no cover - compiled
    """What voxels a view shows where it is not labelled.

    Args:
        voxels: (h, w) int32, voxel of each pixel, -1 for none.
        labelled: (h, w) bool.
        number: (n,) int32, category of each voxel, -1 for none.
        support: (n,) float32, above 0 where there is a category.
        num_names: of categories.

    Returns:
        The category of each pixel, (h, w) int32, -1 for none; and the highest support of each, 0 if it is not shown.
    """
    height, width = voxels.shape
    shown, highest = np.full((height, width), -1, np.int32), np.zeros(num_names, np.float32)
    for y in range(height):
        for x in range(width):
            voxel = voxels[y, x]
            if voxel >= 0 and number[voxel] >= 0 and not labelled[y, x]:
                shown[y, x] = number[voxel]
                highest[number[voxel]] = max(highest[number[voxel]], support[voxel])
    return shown, highest


def _connected_components(mask: Bool[np.ndarray, "h w"], least_px: int) -> Iterator[Bool[np.ndarray, "h w"]]:
    """Connected parts of a mask, the small ones left out."""
    import cv2

    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    window = slice(top, top + height), slice(left, left + width)
    _, part = cv2.connectedComponents(np.ascontiguousarray(mask[window]).view(np.uint8), connectivity=8)
    for number in np.flatnonzero(np.bincount(part.ravel()) >= least_px):
        if number > 0:
            region = np.zeros(mask.shape, bool)
            region[window] = part == number
            yield region
