"""Nested masks: pixels inside two masks of one view belong to the smaller object, such as a cup on a table."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from labeling.generator.objects.seeds import DetectionSeeds


def without_nested(
    seeds: Sequence[DetectionSeeds], num_voxels: int, confident: float, overlap: float
) -> list[DetectionSeeds]:
    """Turns foreground of detections into background where a smaller one of another category lies in the same view.

    Two outlines that a person drew in one view are two objects, whatever their categories. Only the votes of this view
    change; all views together decide what a voxel belongs to.

    Args:
        seeds: of all views.
        num_voxels: size of the cloud.
        confident: only detections at least this confident take anything from others.
        overlap: a detection is nested if at least this share of its foreground lies in the larger one. If their IoU is
            at least this too, the two are one object and nothing changes.

    Returns:
        As many seeds, in the same order.
    """
    of_view: dict[int, list[int]] = defaultdict(list)
    for number, one in enumerate(seeds):
        of_view[one.detection.view_index].append(number)
    found, inside = list(seeds), np.zeros(num_voxels, bool)
    for numbers in of_view.values():
        for small in (seeds[number] for number in numbers if seeds[number].detection.confidence >= confident):
            inside[small.foreground] = True
            for number in numbers:
                if _holds(seeds[number], small, inside, overlap):
                    found[number] = _without(found[number], small, inside)
            inside[small.foreground] = False
    return found


def _holds(large: DetectionSeeds, small: DetectionSeeds, inside: Bool[np.ndarray, "n"], overlap: float) -> bool:
    """Whether ``small``, whose foreground voxels are set in ``inside``, is nested in ``large``, another object."""
    drawn = large.detection.exact and small.detection.exact
    sizes = len(small.foreground), len(large.foreground)
    if sizes[0] >= sizes[1] or (large.detection.category == small.detection.category and not drawn):
        return False
    shared = np.count_nonzero(inside[large.foreground])
    return bool(shared >= overlap * sizes[0] and (drawn or shared < overlap * (sum(sizes) - shared)))


def _without(large: DetectionSeeds, small: DetectionSeeds, inside: Bool[np.ndarray, "n"]) -> DetectionSeeds:
    """``large`` with the foreground of ``small`` (set in ``inside``) as background and as hard negatives."""
    return replace(
        large,
        foreground=large.foreground[~inside[large.foreground]],
        background=np.union1d(large.background, small.foreground),
        hard_negatives=np.union1d(large.hard_negatives, small.foreground),
    )
