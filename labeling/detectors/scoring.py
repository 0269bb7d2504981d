"""How well detectors do on annotated pictures."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from labeling.core.detector import Detector
from labeling.core.rle import encode_mask
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.metrics.mask_ap import average_precision
from labeling.metrics.matching import MaskInstance


@dataclass(frozen=True)
class Scores:
    """How well a detector does on annotated pictures; in [0, 1], None where undefined."""

    mask_ap50: float | None
    mask_ap30: float | None
    box_ap50: float | None
    box_ap30: float | None
    per_class_ap50: dict[str, float | None]
    """Of masks, as ``per_class_ap30``."""
    per_class_ap30: dict[str, float | None]
    per_class_box_ap50: dict[str, float | None]
    per_class_box_ap30: dict[str, float | None]
    pictures: int
    objects: int


def evaluate(
    detector: Detector, pictures: Sequence[AnnotatedPicture], progress: Callable[[Iterable[Any]], Iterable[Any]] = iter
) -> Scores:
    """Scores a detector: ranked AP of masks and boxes, over the categories that it and the annotations share.

    Args:
        detector: any.
        pictures: with ground truth, or whatever is to count as such.
        progress: wraps the sequence of batches, to draw a progress bar.
    """
    truths, found = detect_all(detector, pictures, progress)
    masks, boxes = (average_precision(found, truths, (0.5, 0.3), kind) for kind in ("mask", "box"))
    return Scores(
        mask_ap50=masks.mean[0.5],
        mask_ap30=masks.mean[0.3],
        box_ap50=boxes.mean[0.5],
        box_ap30=boxes.mean[0.3],
        per_class_ap50={name: ap[0.5] for name, ap in masks.per_class.items()},
        per_class_ap30={name: ap[0.3] for name, ap in masks.per_class.items()},
        per_class_box_ap50={name: ap[0.5] for name, ap in boxes.per_class.items()},
        per_class_box_ap30={name: ap[0.3] for name, ap in boxes.per_class.items()},
        pictures=len(pictures),
        objects=sum(not truth.ignore for truth in truths),
    )


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
                MaskInstance(index, category, encode_mask(mask), float(score))
                for category, score, mask in zip(
                    detections.categories, detections.scores, detections.masks, strict=True
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
