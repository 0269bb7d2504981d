"""Scenes of the endless split that policies are compared in, and never trained in or chosen by.

The best of many checkpoints looks better than it is in the scenes that it was chosen by, so these are others than those
of training and validation, which are the first of the split. Other splits are what they are for already.
"""

from collections.abc import Sequence

SHARED_SPLIT = "endless"
COMPARED_IN = 500
"""So many scenes of the endless split, the last ones."""
LEARNT_FROM = 100_000 - COMPARED_IN
"""At most so many, the first ones, are for training and validation."""


def scenes_to_compare_in(split: str, names: Sequence[str]) -> tuple[str, ...]:
    """The scenes of a split that policies may be compared in.

    Args:
        split: name of the split.
        names: of all its scenes; of a world that has few, a quarter is for this.

    Example:
        >>> scenes_to_compare_in("endless", [f"seed/{number}" for number in range(100_000)])[0]
        'seed/99500'
    """
    if split != SHARED_SPLIT:
        return tuple(names)
    return tuple(names[-min(COMPARED_IN, max(1, len(names) // 4)) :])
