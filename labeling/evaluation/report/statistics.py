"""Numbers behind the charts of a report: curves, histograms, confusions, and what is there that should not be."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labeling.evaluation.compare import Evaluation
from labeling.evaluation.report.by_confidence import BINS, STEPS, ByConfidence, by_confidence
from labeling.evaluation.report.errors import KINDS, RIGHT_IOU, kinds_of
from labeling.metrics.mask_ap import precision_curves
from labeling.metrics.matching import MaskInstance, Match, match

SURE = 0.5
"""Confidence from which on predictions stand in the confusion matrix, until the reader says another."""


@dataclass(frozen=True)
class Statistics:
    """Of one method: the detector, or the pseudo-labels."""

    curves: dict[str, list[float]]
    """Category -> precision at the recalls 0, .01, ..., 1; also "" for the mean over categories with ground truth."""
    iou_counts: list[int]
    """Instances of ground truth by the IoU that they were found with."""
    kinds: dict[str, int]
    """Predictions by kind (``labeling.evaluation.report.errors.KINDS``), and missed instances."""
    confusion: dict[str, dict[str, int]]
    """True category -> predicted one -> how often, from a confidence of ``SURE`` on; either may be ``BACKGROUND``."""
    reliability: list[tuple[int, float | None]]
    """By confidence: how many predictions, and their mean IoU with what they stand for."""
    phantoms: list[MaskInstance]
    """Predictions where nothing is, the most confident first."""
    by_confidence: ByConfidence
    """The same counts as the reader's confidence and category have it."""


def statistics_of(evaluation: Evaluation) -> dict[str, Statistics | None]:
    """The numbers of ``detector`` (None if none ran) and ``labels``, on the views evaluated."""
    kept = {view for episode in evaluation.episodes for view in episode.views}
    truths = [item for episode in evaluation.episodes for item in episode.truths]
    detections = [item for episode in evaluation.episodes for item in episode.detections]
    labels = [item for item in evaluation.labels.modal if item.image in kept]
    looked = any(episode.has_detections for episode in evaluation.episodes)
    return {"detector": _statistics(detections, truths) if looked else None, "labels": _statistics(labels, truths)}


def _statistics(predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance]) -> Statistics:
    matches = match(predictions, truths)
    kinds = kinds_of(predictions, truths, matches)
    at = by_confidence(predictions, truths)
    phantoms = [item for item, kind in zip(predictions, kinds, strict=True) if kind == "background"]
    curves = precision_curves(predictions, truths, RIGHT_IOU)
    return Statistics(
        curves={"": np.mean([*curves.values()], axis=0).tolist() if curves else [], **_lists(curves)},
        iou_counts=[sum(int(n[0]) for (_, part), n in at.ious.items() if part == index) for index in range(BINS)],
        kinds={kind: sum(int(n[0]) for (_, one), n in at.kinds.items() if one == kind) for kind in KINDS},
        confusion=_confusion(at, round(SURE * (STEPS - 1))),
        reliability=_reliability(predictions, kinds, matches),
        phantoms=sorted(phantoms, key=lambda item: -item.confidence),
        by_confidence=at,
    )


def _lists(curves: dict[str, np.ndarray]) -> dict[str, list[float]]:
    return {name: curve.tolist() for name, curve in curves.items()}


def _confusion(at: ByConfidence, step: int) -> dict[str, dict[str, int]]:
    found: dict[str, dict[str, int]] = defaultdict(dict)
    for (true, called), count in at.confusion.items():
        if count[step]:
            found[true][called] = int(count[step])
    return dict(found)


def _reliability(
    predictions: Sequence[MaskInstance], kinds: Sequence[str], matches: Sequence[Match]
) -> list[tuple[int, float | None]]:
    iou = {found.prediction: found.iou for found in matches if found.prediction is not None}
    bins: list[list[float]] = [[] for _ in range(BINS)]
    for index, (item, kind) in enumerate(zip(predictions, kinds, strict=True)):
        if kind != "ignored":
            bins[min(BINS - 1, int(item.confidence * BINS))].append(iou.get(index, 0.0))
    return [(len(one), float(np.mean(one)) if one else None) for one in bins]
