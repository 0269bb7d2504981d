"""Numbers behind the charts of a report: curves, histograms, confusions, and what is there that should not be."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labeling.evaluation.compare import Evaluation
from labeling.evaluation.report.errors import KINDS, RIGHT_IOU, kinds_of
from labeling.metrics.mask_ap import precision_curves
from labeling.metrics.matching import MaskInstance, Match, assign, match, pairwise_iou

BINS = 10
"""Of histograms over [0, 1]."""
SURE = 0.5
"""Confidence from which on predictions stand in the confusion matrix."""
BACKGROUND = "background"


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
    counted = [found for found in matches if not truths[found.truth].ignore]
    count = Counter(kinds)
    count["missed"] = sum(found.iou < RIGHT_IOU for found in counted)
    phantoms = [item for item, kind in zip(predictions, kinds, strict=True) if kind == "background"]
    curves = precision_curves(predictions, truths, RIGHT_IOU)
    return Statistics(
        curves={"": np.mean([*curves.values()], axis=0).tolist() if curves else [], **_lists(curves)},
        iou_counts=np.histogram([found.iou for found in counted], BINS, (0.0, 1.0))[0].tolist(),
        kinds={kind: count[kind] for kind in KINDS},
        confusion=_confusion(predictions, truths),
        reliability=_reliability(predictions, kinds, matches),
        phantoms=sorted(phantoms, key=lambda item: -item.confidence),
    )


def _lists(curves: dict[str, np.ndarray]) -> dict[str, list[float]]:
    return {name: curve.tolist() for name, curve in curves.items()}


def _confusion(predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance]) -> dict[str, dict[str, int]]:
    """One-to-one, whatever the categories, from an IoU of ``RIGHT_IOU`` on."""
    by_image: dict[object, tuple[list[MaskInstance], list[MaskInstance]]] = defaultdict(lambda: ([], []))
    for item in predictions:
        if item.confidence >= SURE:
            by_image[item.image][0].append(item)
    for item in truths:
        by_image[item.image][1].append(item)
    count: dict[str, Counter[str]] = defaultdict(Counter)
    for found, there in by_image.values():
        overlap = pairwise_iou(found, there)
        pairs = [(p, t) for p, t in assign(np.where(overlap >= RIGHT_IOU, overlap, 0.0)) if overlap[p, t] >= RIGHT_IOU]
        taken, met = {p for p, _ in pairs}, {t for _, t in pairs}
        for p, t in pairs:
            if not there[t].ignore:
                count[there[t].category][found[p].category] += 1
        for index, item in enumerate(there):
            if index not in met and not item.ignore:
                count[item.category][BACKGROUND] += 1
        for index, item in enumerate(found):
            if index not in taken:
                count[BACKGROUND][item.category] += 1
    return {name: dict(row) for name, row in count.items()}


def _reliability(
    predictions: Sequence[MaskInstance], kinds: Sequence[str], matches: Sequence[Match]
) -> list[tuple[int, float | None]]:
    iou = {found.prediction: found.iou for found in matches if found.prediction is not None}
    bins: list[list[float]] = [[] for _ in range(BINS)]
    for index, (item, kind) in enumerate(zip(predictions, kinds, strict=True)):
        if kind != "ignored":
            bins[min(BINS - 1, int(item.confidence * BINS))].append(iou.get(index, 0.0))
    return [(len(one), float(np.mean(one)) if one else None) for one in bins]
