"""Rows of a bench: what was measured beside which rival, as JSON and for people."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

PER_VIEW = "{} views, for each view"
"""What rows say that tell how labelling grows with the number of views."""


@dataclass(frozen=True)
class Row:
    """One comparison. Without a rival, or with a limit instead of one, the last numbers say so."""

    what: str
    rival: str
    seconds: float
    rival_seconds: float | None
    wanted: str = ""
    """What the project promises about this row."""
    holds: bool | None = None
    """Whether it keeps the promise; None where there is none."""
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """How many times as fast as the rival."""
        return None if self.rival_seconds is None else self.rival_seconds / max(self.seconds, 1e-12)


def as_json(row: Row) -> dict:
    """A row as it is written."""
    return {
        "what": row.what,
        "rival": row.rival,
        "seconds": row.seconds,
        "rival_seconds": row.rival_seconds,
        "ratio": row.ratio,
        "wanted": row.wanted,
        "holds": row.holds,
        "note": row.note,
    }


def ratio_text(row: Row) -> str:
    """How many times as fast as the rival, for people."""
    if row.ratio is None:
        return ""
    return f"{row.ratio:.1f}x" if row.ratio >= 0.95 else f"{row.ratio:.2g}x"


def row_of(content: dict) -> Row:
    """A row from how it was written."""
    return Row(**{name: value for name, value in content.items() if name != "ratio"})


def seconds_per_view(rows: Sequence[Row]) -> dict[int, float]:
    """By the number of views of an episode, of the rows that tell it."""
    found = [(re.fullmatch(PER_VIEW.format(r"(\d+)"), row.what), row.seconds) for row in rows]
    return {int(match[1]): seconds for match, seconds in found if match}


def machine() -> dict:
    """What the numbers were measured on."""
    import os
    import platform

    return {"processor": platform.machine(), "cpus": len(os.sched_getaffinity(0)), "python": platform.python_version()}


def table(name: str, rows: list[Row]) -> str:
    """The rows as text, one a line."""
    cells = [("what", "ours", "rival", "theirs", "ratio", "wanted", "")]
    for row in rows:
        theirs = "" if row.rival_seconds is None else time_text(row.rival_seconds)
        verdict = {True: "holds; ", False: "MISSED; ", None: ""}[row.holds]
        verdict = (verdict + row.note).removesuffix("; ")
        cells.append((row.what, time_text(row.seconds), row.rival, theirs, ratio_text(row), row.wanted, verdict))
    widths = [max(len(line[column]) for line in cells) for column in range(len(cells[0]))]
    lines = ["  ".join(text.ljust(width) for text, width in zip(line, widths, strict=True)).rstrip() for line in cells]
    return "\n".join([f"\n{name}", *lines])


def time_text(seconds: float) -> str:
    """Seconds for people."""
    return f"{1e3 * seconds:.1f} ms" if seconds < 1.0 else f"{seconds:.2f} s"


def median_seconds(work: Callable[[], object], repeats: int) -> float:
    """Median seconds of one call, after one that warms up. The median, since others may use the machine too."""
    import statistics
    import time

    work()
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)
