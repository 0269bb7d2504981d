"""Which prediction stands for which ground-truth instance: IoU of masks and boxes, one-to-one matching, mean IoU."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from hotcoco import mask as coco_mask
from hotcoco.primitives import lsap
from jaxtyping import Bool, Float

from labeling.core.rle import encode_mask
from labeling.core.types import Detection, GroundTruth, PseudoLabel
from labeling.metrics.average_precision import mean_of

Kind = Literal["mask", "box", "own_box"]
"""What is compared: masks, the tightest boxes around them, or boxes as detectors give them (``MaskInstance.box_xywh``),
which is COCO's AP of boxes."""


@dataclass(frozen=True)
class MaskInstance:
    """One object in one picture, predicted or true, as the metrics see it.

    Example:
        >>> from labeling.core.rle import encode_mask
        >>> MaskInstance("view 1", "chair", encode_mask(np.ones((2, 2), bool)), confidence=0.9).category
        'chair'
    """

    image: Any
    """Names the picture; any value that can be hashed and sorted, such as ``(episode, view)`` or an image id."""
    category: str
    rle: dict
    """COCO RLE of the mask (``labeling.core.rle.encode_mask``). Boxes are the tightest ones around the mask."""
    confidence: float = 1.0
    """Ranks predictions; unused for ground truth."""
    ignore: bool = False
    """Ground truth only, COCO's iscrowd: neither rewarded nor punished."""
    box_xywh: tuple[float, float, float, float] | None = None
    """Left, top, width and height of the box that a detector gives beside the mask, pixels; None: the tightest one."""


@dataclass(frozen=True)
class Match:
    """What was found of one ground-truth instance."""

    truth: int
    """Index into the ground truth."""
    prediction: int | None
    """Index into the predictions; None if nothing of this category overlaps the instance."""
    iou: float
    """0 where there is no prediction."""


@dataclass(frozen=True)
class MeanIou:
    """Mask IoU averaged over ground-truth instances; None where there are none to average over."""

    mean_iou: float | None
    """Over all instances that are not ignored; one that nothing overlaps counts 0."""
    mean_iou_matched: float | None
    """Over the instances that some prediction overlaps (IoU above 0)."""
    num_truths: int
    num_matched: int


def instances_of(
    episode: Any, found: Iterable[Detection | GroundTruth | PseudoLabel], part: Literal["modal", "amodal"] = "modal"
) -> list[MaskInstance]:
    """What was found in the views of an episode, as the metrics see it; what has no pixel is left out.

    Args:
        episode: names the episode; ``image`` becomes ``(episode, view_index)``.
        found: detections, ground truth or pseudo-labels.
        part: of ground truth and pseudo-labels the visible part, or the whole object.
    """
    instances = []
    for one in found:
        mask = one.mask if isinstance(one, Detection) else one.modal if part == "modal" else one.amodal
        if mask is not None and mask.any():
            confidence = 1.0 if isinstance(one, GroundTruth) else one.confidence
            ignore = isinstance(one, GroundTruth) and one.ignore
            image = (episode, one.view_index)
            instances.append(MaskInstance(image, one.category, encode_mask(mask), confidence, ignore))
    return instances


def pairwise_iou(
    predictions: Sequence[MaskInstance], ground_truth: Sequence[MaskInstance], kind: Kind = "mask"
) -> Float[np.ndarray, "p g"]:
    """IoU of every prediction with every ground-truth instance of the same picture.

    Args:
        predictions: p instances of one picture.
        ground_truth: g instances of the same picture; ``ignore`` is not looked at: this is plain IoU.
        kind: what to compare.
    """
    if not predictions or not ground_truth:
        return np.zeros((len(predictions), len(ground_truth)))
    p, g = [item.rle for item in predictions], [item.rle for item in ground_truth]
    plain = [False] * len(g)
    if kind == "mask":
        iou = coco_mask.iou(p, g, plain)
    else:
        ours, theirs = (np.array(boxes_of(items, kind)) for items in (predictions, ground_truth))
        iou = coco_mask.bbox_iou(ours, theirs, plain)
    return np.asarray(iou, float).reshape(len(p), len(g))


def boxes_of(items: Sequence[MaskInstance], kind: Kind) -> list[list[float]]:
    """Left, top, width and height of the box of each; the tightest around its mask but for an ``own_box`` it has."""
    tight = coco_mask.to_bbox([item.rle for item in items]).tolist() if items else []
    if kind != "own_box":
        return tight
    return [list(item.box_xywh) if item.box_xywh is not None else box for item, box in zip(items, tight, strict=True)]


def assign(iou: Float[np.ndarray, "p g"]) -> list[tuple[int, int]]:
    """One-to-one pairs (prediction, truth) with the greatest sum of IoU; pairs that do not overlap are left out.

    Source: the assignment problem, Kuhn 1955.
    """
    if iou.size == 0:
        return []
    rows, columns = lsap(np.ascontiguousarray(iou, float), maximize=True)
    return [(int(p), int(g)) for p, g in zip(rows, columns, strict=True) if iou[int(p), int(g)] > 0]


def assign_counted_first(iou: Float[np.ndarray, "p g"], ignored: Sequence[bool]) -> list[tuple[int, int]]:
    """Pairs (prediction, truth) as ``assign`` gives them; ignored truths are left to predictions that no other took.

    Args:
        iou: of predictions and truths of one category in one picture.
        ignored: which of the g truths are ignored.
    """
    ignore = np.asarray(ignored, bool)
    pairs: list[tuple[int, int]] = []
    for wanted in (np.flatnonzero(~ignore), np.flatnonzero(ignore)):
        free = np.setdiff1d(np.arange(len(iou)), [p for p, _ in pairs])
        pairs += [(int(free[p]), int(wanted[g])) for p, g in assign(iou[np.ix_(free, wanted)])]
    return pairs


def match(predictions: Sequence[MaskInstance], ground_truth: Sequence[MaskInstance]) -> list[Match]:
    """Matches predictions to ground truth one to one, within each picture and category, by greatest total mask IoU.

    The best assignment is used rather than COCO's greedy one because it asks how well each object is outlined, whatever
    the order of the confidences; where a category has at most one prediction and one instance in a picture the two
    agree.

    Args:
        predictions: instances of any pictures; confidences play no part.
        ground_truth: instances of any pictures; ignored ones are matched last, by what the others left over.

    Returns:
        One match for every ground-truth instance, in their order.
    """
    groups: dict[tuple[Any, str], tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for side, items in enumerate((predictions, ground_truth)):
        for index, item in enumerate(items):
            groups[item.image, item.category][side].append(index)
    found: dict[int, Match] = {}
    for candidates, truths in groups.values():
        iou = pairwise_iou([predictions[i] for i in candidates], [ground_truth[i] for i in truths])
        for row, column in assign_counted_first(iou, [ground_truth[i].ignore for i in truths]):
            found[truths[column]] = Match(truths[column], candidates[row], float(iou[row, column]))
    return [found.get(index, Match(index, None, 0.0)) for index in range(len(ground_truth))]


def mean_iou(
    ground_truth: Sequence[MaskInstance], matches: Sequence[Match], selected: Bool[np.ndarray, "g"] | None = None
) -> MeanIou:
    """Averages the IoU of matches over the ground-truth instances that are not ignored, each counting the same.

    Args:
        ground_truth: as given to ``match``.
        matches: what ``match`` returned.
        selected: restricts the average to these instances, such as those of one category.
    """
    counted = [m for m in matches if not ground_truth[m.truth].ignore and (selected is None or selected[m.truth])]
    ious = [m.iou for m in counted]
    matched = [iou for iou in ious if iou > 0]
    return MeanIou(mean_of(ious), mean_of(matched), len(ious), len(matched))
