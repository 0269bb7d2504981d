"""What the commands that train on labels have in common."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from labeling.core.errors import UsageError

Labels = tyro.conf.Positional[
    Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LABELS [LABELS ...]", help_behavior_hint="(required)")]
]


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
