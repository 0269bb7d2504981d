"""The detections of two detectors in the same views, put together without duplicates."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from labeling.core.masks import pairwise_mask_iou
from labeling.core.types import Detection
from labeling.metrics.matching import assign

SAME_OBJECT = 0.5
"""IoU from which on two detections of one category in one view mean the same object."""


def pool_detections(first: Sequence[Detection], second: Sequence[Detection]) -> tuple[Detection, ...]:
    """The detections of two detectors, of each object that both have found the more confident one.

    Detectors fail at different things: one that was fine-tuned finds what the pre-trained one missed, and misses some
    that it had found.

    Args:
        first: detections of any views.
        second: those of the other detector. Of two that are equally confident, that of ``first`` stays.

    Returns:
        Those of ``first`` that stay, in their order, then those of ``second``.
    """
    theirs: dict[tuple[int, str], list[int]] = defaultdict(list)
    ours: dict[tuple[int, str], list[int]] = defaultdict(list)
    for places, detections in ((ours, first), (theirs, second)):
        for place, one in enumerate(detections):
            places[one.view_index, one.category].append(place)
    out_of_first, out_of_second = set(), set()
    for which, rows in ours.items():
        columns = theirs.get(which, [])
        if not columns:
            continue
        iou = pairwise_mask_iou(np.stack([first[i].mask for i in rows]), np.stack([second[i].mask for i in columns]))
        for row, column in assign(np.where(iou >= SAME_OBJECT, iou, 0.0)):
            if first[rows[row]].confidence >= second[columns[column]].confidence:
                out_of_second.add(columns[column])
            else:
                out_of_first.add(rows[row])
    return (
        *(one for place, one in enumerate(first) if place not in out_of_first),
        *(one for place, one in enumerate(second) if place not in out_of_second),
    )
