"""Ranked average precision of masks and boxes at any IoU threshold, by COCO's protocol.

The protocol, in full: predictions of one category compete within one picture; the 100 most confident are kept; from the
most confident down each takes the free ground-truth instance of its category with the highest IoU, if that reaches the
threshold (for ignored instances the overlap is counted relative to the prediction alone, any number of predictions may
fall on one, and those are neither right nor wrong); objects of all sizes count. Precision is made monotone and averaged
over 101 recall points 0, .01, ..., 1. A category without any counted ground truth has no AP and stays out of the mean.
Sources: Lin et al. 2014 and the COCO API; all-point interpolation: Padilla et al. 2021 (used in the thesis).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from hotcoco import COCO, COCOeval
from hotcoco import mask as coco_mask
from jaxtyping import Bool, Float

from labeling.metrics.average_precision import AveragePrecision, all_point_area, check_ranking, summarise
from labeling.metrics.matching import Kind, MaskInstance, boxes_of

Interpolation = Literal["101-point", "all-point"]

COCO_IOU_THRESHOLDS = tuple(round(0.5 + 0.05 * step, 2) for step in range(10))
"""The thresholds .50, .55, ..., .95 over which COCO averages its main figure."""

MAX_DETECTIONS = 100
"""Predictions of one category that count in one picture. Source: COCO."""


@dataclass(frozen=True)
class RankedMatches:
    """What became of the predictions of one category, the most confident first."""

    category: str
    images: list[Any]
    """The picture of each."""
    right: Bool[np.ndarray, "thresholds n"]
    """Whether it found an instance of its own."""
    counts: Bool[np.ndarray, "thresholds n"]
    """False where it fell on a region to ignore: neither right nor wrong."""
    truths: dict[Any, int]
    """How many instances there are to find in each picture."""

    def all_point_areas(self) -> list[float]:
        """AP at each threshold by the area of Padilla et al.; -1 where there is nothing to find."""
        total = sum(self.truths.values())
        rows = zip(self.right, self.counts, strict=True)
        return [all_point_area(right[counts], total) if total else -1.0 for right, counts in rows]


def average_precision(
    predictions: Sequence[MaskInstance],
    ground_truth: Sequence[MaskInstance],
    iou_thresholds: Sequence[float] = (0.5, 0.3),
    kind: Kind = "mask",
    interpolation: Interpolation = "101-point",
) -> AveragePrecision:
    """Ranked AP per category and its mean over categories.

    Args:
        predictions: ranked by ``confidence``; of equal ones the picture that sorts first, then the earlier in the
            sequence comes first.
        ground_truth: what there is to find.
        iou_thresholds: overlap from which on a prediction counts as right, each in (0, 1].
        kind: what to compare.
        interpolation: "101-point" (COCO, the default) or "all-point" (the area under the monotone precision curve,
            Padilla et al.). Matching is COCO's in both.

    Raises:
        ValueError: if a threshold lies outside (0, 1] or a confidence is not finite.

    Example:
        >>> square = {"size": [2, 2], "counts": "04"}
        >>> truth = [MaskInstance(1, "chair", square)]
        >>> result = average_precision([MaskInstance(1, "chair", square, confidence=0.9)], truth)
        >>> round(result.per_class["chair"][0.5], 6)
        1.0
    """
    thresholds = check_ranking(iou_thresholds, [item.confidence for item in predictions])
    categories = sorted({item.category for item in [*predictions, *ground_truth]})
    if not categories:
        return summarise({}, thresholds)
    evaluation = _coco_evaluate(predictions, ground_truth, categories, thresholds, kind)
    if interpolation == "101-point":
        # Axes of hotcoco's (and pycocotools') table: threshold, recall, category, area range, detections a picture.
        table = np.asarray(evaluation.eval["precision"])[:, :, :, 0, 0].mean(axis=1)
    else:
        found = _ranked(evaluation, categories, thresholds, {})
        table = np.array([one.all_point_areas() for one in found]).T
    per_class = {
        name: {t: None if table[row, column] < 0 else float(table[row, column]) for row, t in enumerate(thresholds)}
        for column, name in enumerate(categories)
    }
    return summarise(per_class, thresholds)


def precision_curves(
    predictions: Sequence[MaskInstance], ground_truth: Sequence[MaskInstance], iou_threshold: float = 0.5
) -> dict[str, Float[np.ndarray, "101"]]:
    """Monotone precision at the recalls 0, .01, ..., 1 of every category that has ground truth; its mean is the AP.

    Args:
        predictions: as ``average_precision`` takes them.
        ground_truth: likewise.
        iou_threshold: overlap of masks from which on a prediction counts as right.

    Raises:
        ValueError: if the threshold lies outside (0, 1] or a confidence is not finite.
    """
    thresholds = check_ranking([iou_threshold], [item.confidence for item in predictions])
    categories = sorted({item.category for item in [*predictions, *ground_truth]})
    if not categories:
        return {}
    evaluation = _coco_evaluate(predictions, ground_truth, categories, thresholds, "mask")
    table = np.asarray(evaluation.eval["precision"], float)[0, :, :, 0, 0]
    return {name: table[:, column] for column, name in enumerate(categories) if table[0, column] >= 0}


def ranked_matches(
    predictions: Sequence[MaskInstance],
    ground_truth: Sequence[MaskInstance],
    iou_thresholds: Sequence[float] = (0.5,),
    kind: Kind = "mask",
) -> list[RankedMatches]:
    """The matches that AP is made of, of every category of ground truth or predictions, sorted by name.

    Args:
        predictions: as ``average_precision`` takes them.
        ground_truth: likewise.
        iou_thresholds: each in (0, 1].
        kind: what to compare.

    Raises:
        ValueError: if a threshold lies outside (0, 1] or a confidence is not finite.
    """
    thresholds = check_ranking(iou_thresholds, [item.confidence for item in predictions])
    categories = sorted({item.category for item in [*predictions, *ground_truth]})
    if not categories:
        return []
    images = sorted({item.image for item in [*predictions, *ground_truth]})
    evaluation = _coco_evaluate(predictions, ground_truth, categories, thresholds, kind)
    return _ranked(evaluation, categories, thresholds, dict(enumerate(images, start=1)))


def _ranked(
    evaluation: Any, categories: list[str], thresholds: list[float], images: dict[int, Any]
) -> list[RankedMatches]:
    """The matches of an evaluation; pictures are called by their numbers if ``images`` does not name them."""
    pictures = [picture for picture in evaluation.eval_imgs if picture is not None]
    found = []
    for number, category in enumerate(categories, start=1):
        of_category = [picture for picture in pictures if picture["category_id"] == number]
        names = [images.get(picture["image_id"], picture["image_id"]) for picture in of_category]
        scores = np.array([score for picture in of_category for score in picture["dtScores"]], float)
        order = np.argsort(-scores, kind="stable")
        right, ignored = (
            np.array(
                [[one for picture in of_category for one in picture[what][row]] for row in range(len(thresholds))], bool
            ).reshape(len(thresholds), -1)[:, order]
            for what in ("dtMatched", "dtIgnore")
        )
        of_each = [name for name, picture in zip(names, of_category, strict=True) for _ in picture["dtScores"]]
        truths: dict[Any, int] = {}
        for name, picture in zip(names, of_category, strict=True):
            truths[name] = truths.get(name, 0) + sum(not ignored for ignored in picture["gtIgnore"])
        found.append(RankedMatches(category, [of_each[place] for place in order], right & ~ignored, ~ignored, truths))
    return found


def _coco_evaluate(
    predictions: Sequence[MaskInstance],
    ground_truth: Sequence[MaskInstance],
    categories: list[str],
    thresholds: list[float],
    kind: Kind,
) -> Any:
    """Runs hotcoco's COCO evaluation; the only place that knows hotcoco's evaluator.

    Categories are numbered from 1 in the order given, pictures from 1 in sorted order.
    """
    sizes = _picture_sizes([*predictions, *ground_truth])
    images = {image: number for number, image in enumerate(sorted(sizes), start=1)}
    ids = {name: number for number, name in enumerate(categories, start=1)}
    header = {
        "images": [{"id": images[image], "width": sizes[image][1], "height": sizes[image][0]} for image in images],
        "categories": [{"id": number, "name": name} for name, number in ids.items()],
    }
    truth = COCO({**header, "annotations": _records(ground_truth, images, ids, kind)})
    found = COCO({**header, "annotations": _records(predictions, images, ids, kind, scored=True)})
    evaluation = COCOeval(truth, found, "segm" if kind == "mask" else "bbox")
    evaluation.params.iou_thrs = thresholds
    evaluation.params.max_dets = [MAX_DETECTIONS]
    evaluation.params.area_rng = [[0.0, 1e10]]
    evaluation.params.area_rng_lbl = ["all"]
    evaluation.evaluate()
    evaluation.accumulate()
    return evaluation


def _picture_sizes(items: Sequence[MaskInstance]) -> dict[Any, list[int]]:
    """Height and width of each picture, from any of its masks; refuses masks of one picture that differ in size."""
    sizes: dict[Any, list[int]] = {}
    for item in items:
        size = list(item.rle["size"])
        if sizes.setdefault(item.image, size) != size:
            raise ValueError(f"masks of picture {item.image!r} differ in size: {sizes[item.image]} and {size}")
    return sizes


def _records(
    items: Sequence[MaskInstance], images: dict[Any, int], ids: dict[str, int], kind: Kind, scored: bool = False
) -> list[dict]:
    """Instances as COCO annotations."""
    if not items:
        return []
    rles = [item.rle for item in items]
    boxes, areas = boxes_of(items, kind), coco_mask.area(rles).tolist()
    records = []
    for number, (item, box, area) in enumerate(zip(items, boxes, areas, strict=True), start=1):
        record = {
            "id": number,
            "image_id": images[item.image],
            "category_id": ids[item.category],
            "segmentation": item.rle,
            "bbox": box,
            "area": area,
            "iscrowd": int(item.ignore and not scored),
        }
        records.append({**record, "score": float(item.confidence)} if scored else record)
    return records
