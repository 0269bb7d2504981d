"""Figures out of the results of tables: by row, by round, and how much of a gap is closed."""

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from experiments.figures.thesis_values import MEANS


def values(row: Mapping[str, Any], figure: str, category: str | None = None) -> list[float]:
    """A figure of a row in points, one of each seed; without seeds for which it is undefined.

    Args:
        row: of a result.
        figure: "ap50" or "ap30".
        category: None for the mean over all.
    """
    found = [
        run[f"mask_{figure}"] if category is None else run[f"per_class_{figure}"].get(category) for run in row["runs"]
    ]
    return [100.0 * value for value in found if value is not None]


def loop_values(content: Mapping[str, Any], number: int, *place: str) -> list[float]:
    """A figure of a round in points, one of each seed whose loop has come so far.

    Args:
        content: of a loop's result.
        number: of the round, from 1.
        place: where the figure stands in the round's record.
    """
    found = []
    for loop in content["loops"]:
        record: Any = loop["rounds"][number - 1] if number <= len(loop["rounds"]) else {}
        for name in place:
            record = (record or {}).get(name)
        if record is not None:
            found.append(100.0 * record)
    return found


Gap = Sequence[str]
"""Names of rows: before, after, and the ceiling."""


def gap_share(content: Mapping[str, Any], gap: Gap, figure: str = "ap50") -> float | None:
    """Share of the way from before to the ceiling, of the means over seeds: a seed whose ceiling is low would outweigh
    all others in a mean of shares. None where the ceiling is none.

    Args:
        content: of a table's result.
        gap: one of its ``gaps``.
        figure: "ap50" or "ap30".
    """
    before, ours, ceiling = (statistics.fmean(found) for found in _gap_rows(content, gap, figure))
    return _share(before, ours, ceiling)


def gap_shares(content: Mapping[str, Any], gap: Gap, figure: str = "ap50") -> list[float | None]:
    """The same of each seed."""
    return [_share(*one) for one in zip(*_gap_rows(content, gap, figure), strict=True)]


def _gap_rows(content: Mapping[str, Any], gap: Gap, figure: str) -> list[list[float]]:
    rows = {one["name"]: values(one, figure) for one in content["rows"]}
    return [rows[name] for name in gap]


def _share(before: float, ours: float, ceiling: float) -> float | None:
    return (ours - before) / (ceiling - before) if ceiling > before else None


def thesis_gap_share(name: str, gap: Gap, figure: str = "ap50") -> float | None:
    """The same of the thesis' figures; None if it has none of these rows."""
    theirs = MEANS.get(name, {})
    if not all(row in theirs for row in gap):
        return None
    before, ours, ceiling = (theirs[row][figure] for row in gap)
    return (ours - before) / (ceiling - before)
