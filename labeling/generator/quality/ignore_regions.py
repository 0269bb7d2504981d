"""Regions to ignore: they may hold objects that could not be confirmed, so they are no background to learn from.

A detector misses most objects in most views, and finds in one view, at low confidence, what it misses in another.
Detections that no label explains add up over views at the points of the cloud, and where they reach a threshold, every
view marks a region to be ignored.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float32, Int64
from numba import njit

from labeling.core.episode_labels import IgnoredRegion
from labeling.core.masks import blank_masks
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
    unexplained = defaultdict(list)
    for one, rest in _unexplained_detections(detections, labelled):
        unexplained[one.view_index].append((one, rest))
    names = sorted({one.category for found in unexplained.values() for one, _ in found})
    support = category = None
    if config.doubt_across_views and names:
        support, best = _summed_confidence(cloud, unexplained, names)
        category = np.where(support >= config.ignore_unconfirmed, best, -1).astype(np.int32)
    found = []
    for view, voxels in enumerate(cloud.voxel_of_pixel):
        drawn: dict[str, tuple[Bool[np.ndarray, "h w"], float]] = {}
        for one, rest in unexplained.pop(view, ()):  # masks that are no longer needed make room for new ones
            if one.confidence >= config.ignore_unconfirmed:
                drawn[one.category] = _union(drawn.get(one.category), rest, one.confidence)
        if category is not None:
            explained = labelled.get(view, np.zeros(voxels.shape, bool))
            shown, highest = _shown(voxels, explained, category, support, len(names))
            for number in np.flatnonzero(highest > 0):
                name = names[number]
                drawn[name] = _union(drawn.get(name), shown == number, float(highest[number]))
        for name, (mask, confidence) in sorted(drawn.items()):
            regions = _connected_components(mask, max(1, config.min_mask_px))
            found += [IgnoredRegion(view, name, confidence, region) for region in regions]
    return found


def _union(drawn, mask: Bool[np.ndarray, "h w"], confidence: float) -> tuple[Bool[np.ndarray, "h w"], float]:
    """A mask and its confidence joined with what has been drawn before, if anything."""
    confidence = min(1.0, confidence)
    return (mask, confidence) if drawn is None else (drawn[0] | mask, max(drawn[1], confidence))


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
        whole = np.count_nonzero(one.mask)
        if left and left > (1 - EXPLAINED_SHARE) * whole:
            yield one, rest if left < whole else one.mask


def _summed_confidence(
    cloud: Cloud,
    unexplained: Mapping[int, Sequence[tuple[Detection, Bool[np.ndarray, "h w"]]]],
    names: Sequence[str],
) -> tuple[Float32[np.ndarray, "n"], Int64[np.ndarray, "n"]]:
    """For every voxel the sum over views of the highest confidence there, and the category with the highest sum."""
    total = np.zeros(cloud.num_points, np.float32)
    of_name = np.zeros((len(names), cloud.num_points), np.float32)
    for view, found in sorted(unexplained.items()):
        highest = np.zeros(cloud.num_points, np.float32)
        for one, rest in found:
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
    numbers = [number for number in np.flatnonzero(np.bincount(part.ravel()) >= least_px) if number > 0]
    for number, region in zip(numbers, blank_masks(len(numbers), mask.shape), strict=True):
        y = np.flatnonzero((part == number).any(axis=1))
        region[top + y[0] : top + y[-1] + 1, window[1]] = part[y[0] : y[-1] + 1] == number
        yield region
