"""What is wrong with a prediction: kinds of errors, as error analyses of detectors tell them apart."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from hotcoco import mask as coco_mask
from jaxtyping import Bool, Float

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
        told = kinds_in_picture(pairwise_iou(*here), *here, own, inside_ignored(*here))
        for index, kind in zip(found, told, strict=True):
            kinds[index] = kind
    return kinds


def inside_ignored(predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance]) -> Bool[np.ndarray, "p"]:
    """Which predictions of a picture lie by half or more in what is to be ignored of their category, however large that
    is: average precision leaves them out (COCO's ``iscrowd``).
    """
    regions = [one for one in truths if one.ignore]
    if not predictions or not regions:
        return np.zeros(len(predictions), bool)
    share = coco_mask.iou([one.rle for one in predictions], [one.rle for one in regions], [True] * len(regions))
    same = np.array([[one.category == region.category for region in regions] for one in predictions])
    return np.any(same & (np.asarray(share, float).reshape(same.shape) >= RIGHT_IOU), axis=1)


def kinds_in_picture(
    overlap: Float[np.ndarray, "p g"],
    predictions: Sequence[MaskInstance],
    truths: Sequence[MaskInstance],
    own: Mapping[int, int],
    inside: Bool[np.ndarray, "p"],
) -> list[str]:
    """As ``kinds_of``, of one picture.

    Args:
        overlap: IoU of each prediction with each truth.
        predictions: p of one picture.
        truths: g of the same picture.
        own: prediction -> the truth that it is matched with.
        inside: see ``inside_ignored``.
    """
    kinds = []
    for index, item in enumerate(predictions):
        truth = own.get(index)
        if truth is not None and overlap[index, truth] >= RIGHT_IOU:
            kinds.append("ignored" if truths[truth].ignore else "right")
        else:
            kind = _kind(item.category, overlap[index], truths) if truths else "background"
            kinds.append("ignored" if kind == "background" and inside[index] else kind)
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
