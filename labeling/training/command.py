"""What the commands that train on labels or episodes have in common."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import tyro

from labeling.core.errors import UsageError

Labels = tyro.conf.Positional[
    Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LABELS [LABELS ...]", help_behavior_hint="(required)")]
]

Episodes = tyro.conf.Positional[
    Annotated[tuple[Path, ...], tyro.conf.arg(metavar="EPISODES [EPISODES ...]", help_behavior_hint="(required)")]
]
EVERY_HELD_OUT = 10
"""Without --val every tenth episode (of frustum PointNets: object) is held out to choose the best network by."""
_Item = TypeVar("_Item")


def held_out(items: Sequence[_Item]) -> tuple[list[_Item], list[_Item]]:
    """What is learnt from, and every tenth, which is held out.

    >>> held_out(range(12))
    ([0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 11], [9])
    """
    sides: tuple[list[_Item], list[_Item]] = [], []
    for number, one in enumerate(items, start=1):
        sides[number % EVERY_HELD_OUT == 0].append(one)
    return sides


@dataclass(frozen=True)
class TrainingCommand:
    """Options of a command that trains on labels."""

    labels: Labels
    """What to learn from, one or several label sets."""
    out: Path
    """Folder of the run."""
    val: Path | None = None
    """What to choose the best by."""
    dataset: Path | None = None
    """Where the recordings of LABELS lie, if not where the label set says; with one label set only."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""

    @property
    def sources(self) -> str:
        """What is learnt from, in words."""
        return ", ".join(map(str, self.labels))

    def check_sources(self) -> None:
        """Refuses a command without anything to learn from, or with one ``--dataset`` for several label sets.

        Raises:
            UsageError: saying which.
        """
        if not self.labels:
            raise UsageError("nothing to learn from was given: name one or several label sets, or episodes")
        if self.dataset is not None and len(self.labels) > 1:
            raise UsageError(
                f"--dataset says where the pictures of one label set lie, but {len(self.labels)} were given"
            )


say = functools.partial(print, flush=True)
"""Prints a line at once."""
