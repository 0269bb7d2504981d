"""Masks that hold others: what one view shows inside two objects belongs to the smaller one, a cup on its table."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool

from labeling.generator.objects.seeds import DetectionSeeds


def without_nested(
    seeds: Sequence[DetectionSeeds], num_voxels: int, confident: float, overlap: float
) -> list[DetectionSeeds]:
    """The detections without what a smaller one of another category claims in the same view: they see background there.

    What a person drew twice in one view are two objects, of one category or not. Only this view's votes change: where
    other views disagree, the balance of all votes decides.

    Args:
        seeds: of all views.
        num_voxels: size of the cloud.
        confident: only detections at least this confident take anything from others.
        overlap: share of the smaller foreground from which on it lies in the larger one. With this share of their union
            in common the two are one object, and nothing is taken.

    Returns:
        As many, in the same order.
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
    """Whether most of a smaller detection, which is ``inside``, lies in a larger one that is another object."""
    drawn = large.detection.exact and small.detection.exact
    sizes = len(small.foreground), len(large.foreground)
    if sizes[0] >= sizes[1] or (large.detection.category == small.detection.category and not drawn):
        return False
    shared = np.count_nonzero(inside[large.foreground])
    return bool(shared >= overlap * sizes[0] and (drawn or shared < overlap * (sum(sizes) - shared)))


def _without(large: DetectionSeeds, small: DetectionSeeds, inside: Bool[np.ndarray, "n"]) -> DetectionSeeds:
    """A detection with what is ``inside`` a smaller one as background, next to its own mask."""
    return replace(
        large,
        foreground=large.foreground[~inside[large.foreground]],
        background=np.union1d(large.background, small.foreground),
        hard_negatives=np.union1d(large.hard_negatives, small.foreground),
    )
