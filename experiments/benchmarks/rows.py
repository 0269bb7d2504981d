"""Rows of a benchmark: a measurement beside its baseline, as JSON and as text."""

import os
import platform
import re
import statistics
import sys
import time
import timeit
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

PER_VIEW = "{} views, for each view"
"""What rows say that tell how labelling grows with the number of views."""
SAVED_AS = {"baseline": "rival", "baseline_seconds": "rival_seconds", "target": "wanted"}
"""Fields that have another name in files."""
HEADINGS = ("what", "ours", "baseline", "its time", "ratio", "target", "")


@dataclass(frozen=True)
class Row:
    """One comparison. Without a baseline, or with a limit instead of one, the last numbers say so."""

    what: str
    baseline: str
    seconds: float
    baseline_seconds: float | None
    target: str = ""
    """What the project promises about this row."""
    holds: bool | None = None
    """Whether it keeps the promise; None where there is none."""
    note: str = ""
    megabytes: float | None = None
    """Of a row that tells memory: that; its seconds are those of what was done meanwhile."""

    @property
    def ratio(self) -> float | None:
        """How many times as fast as the baseline."""
        return None if self.baseline_seconds is None else self.baseline_seconds / max(self.seconds, 1e-12)

    def cells(self, missed: str = "MISSED") -> list[str]:
        """The row for people, in the order of ``HEADINGS``.

        Args:
            missed: what stands where a promise is not kept.
        """
        verdict = {True: "holds", False: missed, None: ""}[self.holds]
        theirs = "" if self.baseline_seconds is None else time_text(self.baseline_seconds)
        ratio = "" if self.ratio is None else f"{self.ratio:.1f}x" if self.ratio >= 0.95 else f"{self.ratio:.2g}x"
        note = "; ".join(part for part in (verdict, self.note) if part)
        return [self.what, self.ours, self.baseline, theirs, ratio, self.target, note]

    @property
    def ours(self) -> str:
        """What was measured, for people."""
        return time_text(self.seconds) if self.megabytes is None else f"{self.megabytes:.0f} MB"


def as_json(row: Row) -> dict[str, Any]:
    """A row as it is written."""
    return {**{SAVED_AS.get(name, name): value for name, value in asdict(row).items()}, "ratio": row.ratio}


def row_of(content: Mapping[str, Any]) -> Row:
    """A row from how it was written."""
    fields = {saved: name for name, saved in SAVED_AS.items()}
    return Row(**{fields.get(name, name): value for name, value in content.items() if name != "ratio"})


def seconds_per_view(rows: Sequence[Row]) -> dict[int, float]:
    """By the number of views of an episode, of the rows that tell it."""
    found = [(re.fullmatch(PER_VIEW.format(r"(\d+)"), row.what), row.seconds) for row in rows]
    return {int(match[1]): seconds for match, seconds in found if match}


def machine() -> dict[str, Any]:
    """What the numbers were measured on."""
    return {"processor": platform.machine(), "cpus": len(os.sched_getaffinity(0)), "python": platform.python_version()}


def table(name: str, rows: Sequence[Row]) -> str:
    """The rows as text, one a line."""
    lines = [HEADINGS, *(row.cells() for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    padded = ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)) for line in lines]
    return "\n".join([f"\n{name}", *(line.rstrip() for line in padded)])


def time_text(seconds: float) -> str:
    """Seconds for people."""
    return f"{1e3 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.2f} s"


def log(text: str) -> None:
    """Says at once how a bench goes on."""
    print(text, file=sys.stderr, flush=True)


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median seconds of one call, after one that warms up. The median, since others may use the machine too."""
    work()
    return statistics.median(timeit.repeat(work, number=1, repeat=repeats))


def timed(function: Callable, spent: dict[str, float], stage: str) -> Callable:
    """The function, whose seconds are added to ``spent[stage]``."""

    def timing(*given, **named):
        started = time.perf_counter()
        try:
            return function(*given, **named)
        finally:
            spent[stage] += time.perf_counter() - started

    return timing
