"""What is found and what goes wrong at every confidence that predictions may be asked for."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from labeling.evaluation.report.errors import RIGHT_IOU, inside_ignored, kinds_in_picture
from labeling.metrics.matching import MaskInstance, assign, assign_counted_first, pairwise_iou

STEPS = 101
"""Confidences 0, .01, ..., 1: a prediction counts at those that do not exceed its own."""
BINS = 10
"""Of histograms over [0, 1]."""
BACKGROUND = "background"


@dataclass(frozen=True)
class ByConfidence:
    """Counts of one method, each at the confidences 0, .01, ..., 1; predictions below do not exist there."""

    kinds: dict[tuple[str, str], Int[np.ndarray, "101"]]
    """(Category, kind of ``labeling.evaluation.report.errors.KINDS``) -> predictions; of "missed" instances."""
    ious: dict[tuple[str, int], Int[np.ndarray, "101"]]
    """(Category, part of [0, 1] out of ``BINS``) -> instances found with an IoU in it."""
    iou_sum: dict[str, Float[np.ndarray, "101"]]
    """Category -> sum of the IoU that its instances are found with."""
    confusion: dict[tuple[str, str], Int[np.ndarray, "101"]]
    """(True category, predicted one) -> how often; either may be ``BACKGROUND``."""


def by_confidence(predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance]) -> ByConfidence:
    """Counts what is right, wrong and missed at every confidence, each matched anew as if the rest were not there.

    Args:
        predictions: of any pictures.
        truths: of the same pictures.
    """
    found = ByConfidence(
        kinds=defaultdict(_zeros),
        ious=defaultdict(_zeros),
        iou_sum=defaultdict(lambda: np.zeros(STEPS)),
        confusion=defaultdict(_zeros),
    )
    by_image: dict[object, tuple[list[MaskInstance], list[MaskInstance]]] = defaultdict(lambda: ([], []))
    for side, items in enumerate((predictions, truths)):
        for item in items:
            by_image[item.image][side].append(item)
    for here, there in by_image.values():
        overlap, inside = pairwise_iou(here, there), inside_ignored(here, there)
        for steps, alive in _changes(np.array([item.confidence for item in here])):
            kept = [item for item, yes in zip(here, alive, strict=True) if yes]
            _count(found, steps, overlap[alive], kept, there, inside[alive])
    return found


def _zeros() -> Int[np.ndarray, "101"]:
    return np.zeros(STEPS, int)


def _changes(confidence: Float[np.ndarray, "p"]) -> Iterator[tuple[slice, Bool[np.ndarray, "p"]]]:
    """Runs of steps, and which predictions count at them."""
    counts_at = confidence[:, None] >= np.arange(STEPS) / (STEPS - 1)
    ends = np.unique([STEPS, *counts_at.sum(axis=1)])
    start = 0
    for end in ends[ends > 0].tolist():
        yield slice(start, end), counts_at[:, start]
        start = end


def _count(
    found: ByConfidence,
    steps: slice,
    overlap: Float[np.ndarray, "p g"],
    predictions: Sequence[MaskInstance],
    truths: Sequence[MaskInstance],
    inside: Bool[np.ndarray, "p"],
) -> None:
    """Adds one picture at some steps; ``inside`` is as in ``kinds_in_picture``."""
    called, is_of = (np.array([item.category for item in items], object) for items in (predictions, truths))
    ignored = np.array([item.ignore for item in truths], bool)
    own: dict[int, int] = {}
    for name in set(called) & set(is_of):
        rows, columns = np.flatnonzero(called == name), np.flatnonzero(is_of == name)
        pairs = assign_counted_first(overlap[np.ix_(rows, columns)], ignored[columns].tolist())
        own |= {int(rows[p]): int(columns[g]) for p, g in pairs}
    for item, kind in zip(predictions, kinds_in_picture(overlap, predictions, truths, own, inside), strict=True):
        found.kinds[item.category, kind][steps] += 1
    best = {truth: float(overlap[prediction, truth]) for prediction, truth in own.items()}
    for index, item in enumerate(truths):
        if not item.ignore:
            iou = best.get(index, 0.0)
            found.kinds[item.category, "missed"][steps] += iou < RIGHT_IOU
            found.ious[item.category, min(BINS - 1, int(iou * BINS))][steps] += 1
            found.iou_sum[item.category][steps] += iou
    _count_confusion(found.confusion, steps, overlap, predictions, truths, inside)


def _count_confusion(
    confusion: dict[tuple[str, str], Int[np.ndarray, "101"]],
    steps: slice,
    overlap: Float[np.ndarray, "p g"],
    predictions: Sequence[MaskInstance],
    truths: Sequence[MaskInstance],
    inside: Bool[np.ndarray, "p"],
) -> None:
    """One-to-one, whatever the categories, from an IoU of ``RIGHT_IOU`` on."""
    pairs = [(p, g) for p, g in assign(np.where(overlap >= RIGHT_IOU, overlap, 0.0)) if overlap[p, g] >= RIGHT_IOU]
    taken, met = {p for p, _ in pairs}, {g for _, g in pairs}
    for p, g in pairs:
        if not truths[g].ignore:
            confusion[truths[g].category, predictions[p].category][steps] += 1
    for index, item in enumerate(truths):
        if index not in met and not item.ignore:
            confusion[item.category, BACKGROUND][steps] += 1
    for index, item in enumerate(predictions):
        if index not in taken and not inside[index]:
            confusion[BACKGROUND, item.category][steps] += 1
