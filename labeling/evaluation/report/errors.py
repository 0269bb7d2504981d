"""What is wrong with a prediction: kinds of errors, as error analyses of detectors tell them apart."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

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
    partner = {found.prediction: found.truth for found in matches if found.prediction is not None}
    by_image: dict[object, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for side, items in enumerate((predictions, truths)):
        for index, item in enumerate(items):
            by_image[item.image][side].append(index)
    kinds = [""] * len(predictions)
    for found, there in by_image.values():
        here = [predictions[i] for i in found], [truths[i] for i in there]
        own = {found.index(p): there.index(partner[p]) for p in found if p in partner}
        for index, kind in zip(found, kinds_in_picture(pairwise_iou(*here), *here, own), strict=True):
            kinds[index] = kind
    return kinds


def kinds_in_picture(
    overlap: Float[np.ndarray, "p g"],
    predictions: Sequence[MaskInstance],
    truths: Sequence[MaskInstance],
    own: Mapping[int, int],
) -> list[str]:
    """As ``kinds_of``, of one picture.

    Args:
        overlap: IoU of each prediction with each truth.
        predictions: p of one picture.
        truths: g of the same picture.
        own: prediction -> the truth that it is matched with.
    """
    kinds = []
    for index, item in enumerate(predictions):
        truth = own.get(index)
        if truth is not None and overlap[index, truth] >= RIGHT_IOU:
            kinds.append("ignored" if truths[truth].ignore else "right")
        else:
            kinds.append(_kind(item.category, overlap[index], truths) if truths else "background")
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
