"""What is wrong with a prediction: kinds of errors, as error analyses of detectors tell them apart."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from labeling.metrics.matching import MaskInstance, Match, pairwise_iou

RIGHT_IOU, NEAR_IOU = 0.5, 0.1
"""Overlap from which on a prediction is right, and means an object at all. Source: Bolya et al. 2020."""
KINDS = {
    "right": "right",
    "localisation": "badly outlined",
    "classification": "wrong category",
    "duplicate": "second of an object",
    "background": "phantom: nothing there",
    "ignored": "on what is ignored",
    "missed": "missed object",
}
"""Kind -> what the report calls it. All but "missed", which is of ground truth, are of predictions."""


def kinds_of(
    predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance], matches: Sequence[Match]
) -> list[str]:
    """The kind of each prediction.

    Args:
        predictions: of any pictures.
        truths: of the same pictures.
        matches: what ``labeling.metrics.matching.match`` gives for both.

    Returns:
        For each prediction a key of ``KINDS``. Source: the error types of TIDE, Bolya et al. 2020; matching is the best
        assignment instead of the greedy one.
    """
    partner = {found.prediction: found for found in matches if found.prediction is not None}
    by_image: dict[object, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for side, items in enumerate((predictions, truths)):
        for index, item in enumerate(items):
            by_image[item.image][side].append(index)
    kinds = ["background"] * len(predictions)
    for found, there in by_image.values():
        overlap = pairwise_iou([predictions[i] for i in found], [truths[i] for i in there])
        for row, index in enumerate(found):
            match = partner.get(index)
            if match is not None and match.iou >= RIGHT_IOU:
                kinds[index] = "ignored" if truths[match.truth].ignore else "right"
            elif there:
                kinds[index] = _kind(predictions[index].category, overlap[row], [truths[i] for i in there])
    return kinds


def _kind(category: str, overlap: np.ndarray, truths: Sequence[MaskInstance]) -> str:
    """Of a prediction that is no object's own, by its IoU with each instance in its picture."""
    same = np.array([truth.category == category for truth in truths])
    ignored = np.array([truth.ignore for truth in truths])

    def best(of: np.ndarray) -> float:
        return float(overlap[of].max(initial=0.0))

    if best(same & ~ignored) >= RIGHT_IOU:
        return "duplicate"
    if best(~same & ~ignored) >= RIGHT_IOU:
        return "classification"
    if best(same & ~ignored) >= NEAR_IOU:
        return "localisation"
    return "ignored" if best(ignored) >= NEAR_IOU else "background"
