"""Which scenes of the endless split are learnt from, by which policies are chosen, and in which they are compared.

The best of many checkpoints looks better than it is in the scenes that it was chosen by, so these are others than those
of a comparison. Other splits are what they are for already, and have no shares.
"""

from collections.abc import Sequence
from typing import Literal

SHARED_SPLIT = "endless"
HELD_OUT = 500
"""Scenes of the endless split to choose by, and as many to compare in: its last ones, so that whoever takes the first
ones learns from them."""

Purpose = Literal["learning", "choosing", "comparing"]


def scenes_for(purpose: Purpose, split: str, names: Sequence[str]) -> tuple[str, ...]:
    """The scenes of a split that may be used for something.

    Args:
        purpose: what for.
        split: name of the split.
        names: of all its scenes.

    Example:
        >>> names = [f"seed/{number}" for number in range(100_000)]
        >>> [scenes_for(purpose, "endless", names)[0] for purpose in ("learning", "choosing", "comparing")]
        ['seed/0', 'seed/99000', 'seed/99500']
    """
    if split != SHARED_SPLIT:
        return tuple(names)
    held_out = min(HELD_OUT, len(names) // 3)
    parts = {
        "learning": slice(0, len(names) - 2 * held_out),
        "choosing": slice(len(names) - 2 * held_out, len(names) - held_out),
        "comparing": slice(len(names) - held_out, len(names)),
    }
    return tuple(names[parts[purpose]])
