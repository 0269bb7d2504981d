"""Ranked average precision of 3-D boxes, by category and by distance.

The protocol is that of masks (``labeling.metrics.mask_ap``), with overlap of volumes: predictions of one category
compete within one view; from the most confident down each takes the free ground-truth box of its category with the
highest IoU, if that reaches the threshold; a prediction that lies on a box to be ignored (by the share of its own
volume) is neither right nor wrong. Precision is made monotone and averaged over 101 recall points.
"""

from collections import Counter, defaultdict
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Bool

from labeling.core.box_overlap import box_iou_3d, box_iou_bev, intersection_volume
from labeling.core.types import Box3d
from labeling.metrics.average_precision import AveragePrecision, check_ranking, interpolated_area, summarise
from labeling.metrics.mask_ap import RankedMatches

Overlap = Literal["3d", "bev"]
IOU_THRESHOLDS = (0.25, 0.5)
_ROUNDING = 1e-7
"""An overlap that falls short of a threshold by less has reached it."""


@dataclass(frozen=True)
class BoxInstance:
    """One box of one object in one view."""

    image: Hashable
    """The view; sortable among the views of an evaluation."""
    category: str
    box: Box3d
    confidence: float = 1.0
    """Of a prediction."""
    range_m: float = 0.0
    """Distance of its centre from the camera."""
    ignore: bool = False
    """Of ground truth: neither to be found nor to be missed."""


def average_precision_3d(
    predictions: Sequence[BoxInstance],
    ground_truth: Sequence[BoxInstance],
    iou_thresholds: Sequence[float] = IOU_THRESHOLDS,
    kind: Overlap = "3d",
) -> AveragePrecision:
    """Ranked AP per category and its mean over categories.

    Args:
        predictions: ranked by ``confidence``; of equal ones the earlier in the sequence comes first.
        ground_truth: what there is to find.
        iou_thresholds: overlap from which on a prediction counts as right, each in (0, 1].
        kind: overlap of volumes, or of footprints in bird's-eye view.

    Raises:
        ValueError: if a threshold lies outside (0, 1], or a confidence is not finite.
    """
    thresholds = check_ranking(iou_thresholds, [item.confidence for item in predictions])
    per_class: dict[str, dict[float, float | None]] = {}
    for one in ranked_box_matches(predictions, ground_truth, thresholds, kind):
        wanted, rows = sum(one.truths.values()), zip(thresholds, one.right, one.counts, strict=True)
        per_class[one.category] = {
            t: interpolated_area(right[counts], wanted) if wanted else None for t, right, counts in rows
        }
    return summarise(per_class, thresholds)


def ranked_box_matches(
    predictions: Sequence[BoxInstance],
    ground_truth: Sequence[BoxInstance],
    iou_thresholds: Sequence[float] = IOU_THRESHOLDS,
    kind: Overlap = "3d",
) -> list[RankedMatches]:
    """The matches that AP is made of, of every category of ground truth or predictions, sorted by name.

    Args:
        predictions: as ``average_precision_3d`` takes them.
        ground_truth: likewise.
        iou_thresholds: likewise.
        kind: likewise.

    Raises:
        ValueError: if a threshold lies outside (0, 1], or a confidence is not finite.
    """
    thresholds = check_ranking(iou_thresholds, [item.confidence for item in predictions])
    matches = []
    for category in sorted({item.category for item in [*predictions, *ground_truth]}):
        found = [item for item in predictions if item.category == category]
        truths = [item for item in ground_truth if item.category == category]
        order = np.argsort([-item.confidence for item in found], kind="stable")
        overlaps = _overlaps(found, truths, kind)
        ranked = [overlaps[place] for place in order]
        right, counts = zip(*(_matches(ranked, truths, threshold) for threshold in thresholds), strict=True)
        wanted = Counter(truth.image for truth in truths if not truth.ignore)
        images = [found[place].image for place in order]
        matches.append(RankedMatches(category, images, np.array(right), np.array(counts), dict(wanted)))
    return matches


def average_precision_by_range(
    predictions: Sequence[BoxInstance],
    ground_truth: Sequence[BoxInstance],
    edges_m: Sequence[float],
    iou_thresholds: Sequence[float] = IOU_THRESHOLDS,
) -> dict[tuple[float, float], AveragePrecision]:
    """AP of objects at several distances.

    Ground truth at other distances is to be ignored, and so are predictions at other distances that find nothing, at
    each threshold by itself.

    Args:
        predictions: of all distances.
        ground_truth: of all distances.
        edges_m: between the distances, rising.
        iou_thresholds: as in ``average_precision_3d``.

    Returns:
        By the nearest and the farthest distance of each bin.
    """
    rivals: dict[tuple[Hashable, str], list[Box3d]] = defaultdict(list)
    for truth in ground_truth:
        rivals[truth.image, truth.category].append(truth.box)
    best = [
        max((box_iou_3d(one.box, box) for box in rivals[one.image, one.category]), default=0.0) for one in predictions
    ]
    found = {}
    for low, high in pairwise(edges_m):
        truths = [item if low <= item.range_m < high else replace(item, ignore=True) for item in ground_truth]
        at_each: dict[float, AveragePrecision] = {}
        for threshold in map(float, iou_thresholds):
            kept = [
                item
                for item, iou in zip(predictions, best, strict=True)
                if iou >= threshold - _ROUNDING or low <= item.range_m < high
            ]
            at_each[threshold] = average_precision_3d(kept, truths, (threshold,))
        found[low, high] = _joined(at_each)
    return found


def _joined(at_each: Mapping[float, AveragePrecision]) -> AveragePrecision:
    """AP at several thresholds, each from a ranking of its own, as one record."""
    names = sorted({name for one in at_each.values() for name in one.per_class})
    per_class = {name: {t: one.per_class.get(name, {}).get(t) for t, one in at_each.items()} for name in names}
    return summarise(per_class, list(at_each))


def _overlaps(
    found: Sequence[BoxInstance], truths: Sequence[BoxInstance], kind: Overlap
) -> list[list[tuple[int, float]]]:
    """For each prediction the truths of its view, and how far it overlaps them; where they are to be ignored, the share
    of its own volume.
    """
    of_view: dict[Hashable, list[int]] = defaultdict(list)
    for number, truth in enumerate(truths):
        of_view[truth.image].append(number)

    def overlap(box: Box3d, truth: BoxInstance) -> float:
        if not truth.ignore:
            return box_iou_3d(box, truth.box) if kind == "3d" else box_iou_bev(box, truth.box)
        volume = float(np.prod(box.extent_m))
        return intersection_volume(box, truth.box) / volume if volume > 0 else 0.0

    return [[(number, overlap(one.box, truths[number])) for number in of_view[one.image]] for one in found]


def _matches(
    overlaps: Sequence[Sequence[tuple[int, float]]], truths: Sequence[BoxInstance], threshold: float
) -> tuple[Bool[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Which predictions of one category, the most confident first, find a box, and which count."""
    taken: set[int] = set()
    right, counts = np.zeros(len(overlaps), bool), np.ones(len(overlaps), bool)
    for rank, some in enumerate(overlaps):
        reached = [(number, value) for number, value in some if value >= threshold - _ROUNDING]
        free = [(value, -number) for number, value in reached if not truths[number].ignore and number not in taken]
        if free:
            taken.add(-max(free)[1])
            right[rank] = True
        else:
            counts[rank] = not any(truths[number].ignore for number, _ in reached)
    return right, counts
