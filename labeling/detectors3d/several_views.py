"""Boxes of one object that were found more than once: the surest is kept, or all of them are averaged."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from labeling.core.box_overlap import box_iou_3d
from labeling.core.types import Box3d
from labeling.detectors3d.base import Detection3d
from labeling.detectors3d.upright_boxes import HALF_TURN, decode_box, encode_box

SAME_OBJECT_IOU = 0.25
"""Boxes of one category that overlap by so much are of one object."""
QUARTER_TURN = HALF_TURN / 2


@dataclass(frozen=True)
class SceneDetection3d:
    """A box in the world, found from several views together."""

    views: tuple[int, ...]
    """Indices of the views that it was found from."""
    category: str
    confidence: float
    """In [0, 1]."""
    box: Box3d


def suppress_3d(
    boxes: Sequence[Box3d], scores: Sequence[float], categories: Sequence[str], iou: float = SAME_OBJECT_IOU
) -> list[int]:
    """Non-maximum suppression with the exact overlap of volumes, category by category.

    Args:
        boxes: in any orientation.
        scores: of each; of equal ones the earlier comes first.
        categories: of each.
        iou: from which overlap on a box is left out because of a surer one that is kept.

    Returns:
        Which boxes are kept, the surest first.
    """
    return [members[0] for members in _groups(boxes, scores, categories, iou)]


def fuse_views(detections: Sequence[Detection3d], views: int, iou: float = SAME_OBJECT_IOU) -> list[SceneDetection3d]:
    """One box for each object that was found from one or several views.

    Boxes that overlap the surest of their category are averaged with it, weighted by confidence; headings within a
    quarter turn, so that a box whose sides were exchanged counts the right way.

    Args:
        detections: of all views of a scene, with upright boxes.
        views: how many views were looked at.
        iou: from which overlap on two boxes are of one object.

    Returns:
        Boxes whose confidence is the mean over all views of the surest detection in each, 0 where a view has none.
    """
    found = []
    boxes, scores = [one.box for one in detections], [one.confidence for one in detections]
    for members in _groups(boxes, scores, [one.category for one in detections], iou):
        some = [detections[number] for number in members]
        surest: dict[int, float] = {}
        for one in some:
            surest[one.view_index] = max(one.confidence, surest.get(one.view_index, 0.0))
        box = mean_box([one.box for one in some], np.array([max(one.confidence, 1e-6) for one in some]))
        found.append(SceneDetection3d(tuple(sorted(surest)), some[0].category, sum(surest.values()) / views, box))
    return found


def mean_box(boxes: Sequence[Box3d], weights: Float[np.ndarray, "n"]) -> Box3d:
    """The weighted mean of upright boxes of one object; the first says which of its sides is called which."""
    numbers = np.stack([encode_box(box) for box in boxes])
    turns = np.round((numbers[:, 6] - numbers[0, 6]) / QUARTER_TURN)
    exchanged = turns % 2 == 1
    numbers[exchanged, 3:5] = numbers[exchanged, 4:2:-1]
    numbers[:, 6] -= turns * QUARTER_TURN
    return decode_box(np.average(numbers, axis=0, weights=weights))


def _groups(boxes: Sequence[Box3d], scores: Sequence[float], categories: Sequence[str], iou: float) -> list[list[int]]:
    """Boxes by the kept one that they overlap, which comes first; the surest first."""
    groups: list[list[int]] = []
    of_category: dict[str, list[list[int]]] = defaultdict(list)
    for number in sorted(range(len(boxes)), key=lambda one: -scores[one]):
        rivals = of_category[categories[number]]
        overlaps = [box_iou_3d(boxes[members[0]], boxes[number]) for members in rivals]
        if rivals and max(overlaps) >= iou:
            rivals[int(np.argmax(overlaps))].append(number)
        else:
            rivals.append([number])
            groups.append(rivals[-1])
    return groups
