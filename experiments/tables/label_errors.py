"""Which labels are false, and which objects have none: labels of pictures beside ground truth of the same."""

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture, Annotation

SAME_OBJECT = 0.5
"""A label stands for an object of its category whose mask has at least this IoU with it."""


def count_errors(
    labels: "Sequence[AnnotatedPicture]",
    truths: "Sequence[AnnotatedPicture]",
    categories: Collection[str] | None = None,
) -> dict[str, Any]:
    """How many labels there are by category, how many of them are false, and how many objects have none.

    A label of an object that is to be ignored counts as nothing.

    Args:
        labels: pictures with labels.
        truths: the same pictures, in any order, with ground truth.
        categories: that count; None takes those that are labelled.

    Returns:
        ``categories``: the counts. ``false_weight``: the share of false labels in the weight of all, in [0, 1].
    """
    known = {file_in_dataset(picture): picture for picture in truths}
    labelled = {one.category for picture in labels for one in picture.annotations if not one.ignore}
    names = sorted(labelled if categories is None else categories)
    counts = {name: {"labels": 0, "false": 0, "objects": 0, "missing": 0} for name in names}
    weights = {"right": 0.0, "all": 0.0}
    for picture in labels:
        truth = known[file_in_dataset(picture)]
        pairs = objects_of(picture, truth)
        neither = of_ignored(picture, truth, pairs)
        labels_of = [one for one in picture.annotations if not any(one is other for other in neither)]
        weights["right"] += sum(label.weight for label, _ in pairs)
        weights["all"] += sum(one.weight for one in labels_of if not one.ignore)
        for all_of, errors, annotations, right in (
            ("labels", "false", labels_of, [label.category for label, _ in pairs]),
            ("objects", "missing", truth.annotations, [one.category for _, one in pairs]),
        ):
            for name in names:
                count = sum(one.category == name and not one.ignore for one in annotations)
                counts[name][all_of] += count
                counts[name][errors] += count - right.count(name)
    return {"categories": counts, "false_weight": 1 - weights["right"] / max(weights["all"], 1e-9)}


def objects_of(picture: "AnnotatedPicture", truth: "AnnotatedPicture") -> "list[tuple[Annotation, Annotation]]":
    """Labels of a picture with the objects that they stand for, one to one; false labels are left out."""
    from labeling.metrics.matching import MaskInstance, assign, pairwise_iou

    labels, objects = ([one for one in both.annotations if not one.ignore] for both in (picture, truth))
    ours, theirs = ([MaskInstance(0, one.category, one.rle) for one in some] for some in (labels, objects))
    iou = pairwise_iou(ours, theirs)
    same = np.array([[a.category == b.category for b in objects] for a in labels], bool).reshape(iou.shape)
    return [(labels[p], objects[g]) for p, g in assign(np.where(same & (iou >= SAME_OBJECT), iou, 0.0))]


def of_ignored(
    picture: "AnnotatedPicture", truth: "AnnotatedPicture", pairs: "Sequence[tuple[Annotation, Annotation]]"
) -> "list[Annotation]":
    """Labels of a picture that stand for an object that is to be ignored, such as a sliver, and for none of ``pairs``
    (``objects_of``).
    """
    from labeling.metrics.matching import MaskInstance, pairwise_iou

    left = [one for one in picture.annotations if not one.ignore and not any(one is label for label, _ in pairs)]
    ignored = [one for one in truth.annotations if one.ignore]
    ours, theirs = ([MaskInstance(0, one.category, one.rle) for one in some] for some in (left, ignored))
    near = pairwise_iou(ours, theirs) >= SAME_OBJECT
    same = np.array([[a.category == b.category for b in ignored] for a in left], bool).reshape(near.shape)
    return [left[place] for place in np.flatnonzero(np.any(near & same, axis=1))]


def file_in_dataset(picture: "AnnotatedPicture") -> tuple[str, ...]:
    """Where a picture is within its dataset: folder of the episode, and file."""
    return picture.file.parts[-3:]
