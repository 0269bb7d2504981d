"""How well detectors do on annotated pictures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labeling.core.detector import Detector
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.metrics.average_precision import mean_of
from labeling.metrics.mask_ap import COCO_IOU_THRESHOLDS, average_precision
from labeling.metrics.matching import Kind, MaskInstance
from labeling.metrics.resampled_ap import MIN_SCENES, resampled_ap

KINDS: tuple[Kind, ...] = ("mask", "box", "own_box")
THRESHOLDS = (0.3, *COCO_IOU_THRESHOLDS)


@dataclass(frozen=True)
class Scores:
    """How well a detector does on annotated pictures; in [0, 1], None where undefined."""

    mask_ap50: float | None
    mask_ap30: float | None
    box_ap50: float | None
    """Of the tightest boxes around masks, as ``box_ap30`` and ``box_ap``; ``own_box_ap50`` and the like are of boxes as
    the detector gives them, which is COCO's AP of boxes."""
    box_ap30: float | None
    mask_ap: float | None
    """Mean over the IoU thresholds .50, .55, ..., .95, COCO's main figure; so is ``box_ap``."""
    box_ap: float | None
    own_box_ap50: float | None
    own_box_ap30: float | None
    own_box_ap: float | None
    per_class_ap50: dict[str, float | None]
    """Of masks, as ``per_class_ap30``."""
    per_class_ap30: dict[str, float | None]
    per_class_box_ap50: dict[str, float | None]
    per_class_box_ap30: dict[str, float | None]
    per_class_own_box_ap50: dict[str, float | None]
    per_class_own_box_ap30: dict[str, float | None]
    pictures: int
    objects: int
    resampled: dict[str, list[float]] | None = None
    """AP at .5 and .3 and COCO's AP of masks and both kinds of boxes when scenes are drawn again, draw by draw the same
    for all detectors; None where this was not asked for, or there are too few scenes."""


def evaluate(
    detector: Detector,
    pictures: Sequence[AnnotatedPicture],
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
    resample: bool = False,
) -> Scores:
    """Scores a detector: ranked AP of masks and boxes, over the categories that it and the annotations share.

    Args:
        detector: any.
        pictures: with ground truth, or whatever is to count as such.
        progress: wraps the sequence of batches, to draw a progress bar.
        resample: draw the scenes again, to tell how much figures hang on them.
    """
    truths, found = detect_all(detector, pictures, progress)
    masks, boxes, own = (average_precision(found, truths, THRESHOLDS, kind) for kind in KINDS)
    mask_ap, box_ap, own_box_ap = (mean_of([one.mean[at] for at in COCO_IOU_THRESHOLDS]) for one in (masks, boxes, own))
    return Scores(
        mask_ap=mask_ap,
        box_ap=box_ap,
        own_box_ap=own_box_ap,
        mask_ap50=masks.mean[0.5],
        mask_ap30=masks.mean[0.3],
        box_ap50=boxes.mean[0.5],
        box_ap30=boxes.mean[0.3],
        own_box_ap50=own.mean[0.5],
        own_box_ap30=own.mean[0.3],
        per_class_ap50={name: ap[0.5] for name, ap in masks.per_class.items()},
        per_class_ap30={name: ap[0.3] for name, ap in masks.per_class.items()},
        per_class_box_ap50={name: ap[0.5] for name, ap in boxes.per_class.items()},
        per_class_box_ap30={name: ap[0.3] for name, ap in boxes.per_class.items()},
        per_class_own_box_ap50={name: ap[0.5] for name, ap in own.per_class.items()},
        per_class_own_box_ap30={name: ap[0.3] for name, ap in own.per_class.items()},
        pictures=len(pictures),
        objects=sum(not truth.ignore for truth in truths),
        resampled=_resampled(found, truths, pictures) if resample else None,
    )


def _resampled(
    found: Sequence[MaskInstance], truths: Sequence[MaskInstance], pictures: Sequence[AnnotatedPicture]
) -> dict[str, list[float]] | None:
    scenes = {index: picture.scene for index, picture in enumerate(pictures) if picture.scene}
    if len(scenes) < len(pictures) or len(set(scenes.values())) < MIN_SCENES:
        return None
    result = {}
    for kind in KINDS:
        draws = {at: np.nan_to_num(one) for at, one in resampled_ap(found, truths, scenes, THRESHOLDS, kind).items()}
        figures = {"ap50": draws[0.5], "ap30": draws[0.3], "ap": np.mean([draws[at] for at in COCO_IOU_THRESHOLDS], 0)}
        result |= {f"{kind}_{name}": one.round(4).tolist() for name, one in figures.items()}
    return result


def detect_all(
    detector: Detector, pictures: Sequence[AnnotatedPicture], progress: Callable[[Iterable[Any]], Iterable[Any]] = iter
) -> tuple[list[MaskInstance], list[MaskInstance]]:
    """Ground truth and findings of all pictures, of the categories that the detector has names for.

    Findings of categories that are annotated nowhere are left out: nothing is known about them.
    """
    known = None if detector.categories is None else set(detector.categories)
    truths = [
        MaskInstance(index, one.category, one.rle, ignore=one.ignore)
        for index, picture in enumerate(pictures)
        for one in picture.annotations
        if known is None or one.category in known
    ]
    shared = {truth.category for truth in truths}
    found: list[MaskInstance] = []
    for group in progress(list(_groups(pictures, detector.batch_size))):
        rgb = np.stack([pictures[index].rgb() for index in group])
        for index, detections in zip(group, detector.detect(rgb), strict=True):
            found.extend(
                MaskInstance(
                    index, category, encode_mask(mask), float(score), box_xywh=(left, top, right - left, bottom - top)
                )
                for category, score, mask, (left, top, right, bottom) in zip(
                    *(detections.categories, detections.scores, detections.masks, detections.boxes_xyxy.tolist()),
                    strict=True,
                )
                if category in shared and mask.any()
            )
    return truths, found


def _groups(pictures: Sequence[AnnotatedPicture], size: int) -> Iterable[list[int]]:
    """Indices of pictures of one size, so many at a time."""
    of_size: dict[tuple[int, int], list[int]] = {}
    for index, picture in enumerate(pictures):
        of_size.setdefault(picture.size, []).append(index)
    for indices in of_size.values():
        for start in range(0, len(indices), size):
            yield indices[start : start + size]
