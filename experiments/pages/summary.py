"""The table at the top of the page of results: figures of the thesis, of an earlier commit and of today, and goals."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from experiments.figures.result_values import (
    LOOP_GAP,
    Gap,
    gap_interval,
    gap_share,
    loop_table,
    loop_values,
    ratio_to_ceiling,
    row_interval,
    share_interval,
    values,
)
from experiments.pages.markdown import table
from experiments.pages.origin import of_earlier_generator
from experiments.tables.table_5_5 import CEILING, SHARED

ROWS: list[dict[str, Any]] = yaml.safe_load(Path(__file__).with_name("summary.yaml").read_text(encoding="utf-8"))
GAP = ("pre-trained", "SbM fine-tuned on shared labels", "GT fine-tuned")
"""Whose share is told."""
SHARES = ("share", "loop")
"""Kinds of rows that tell the share of a gap: of a table, and of the last round of a loop."""
FIGURES, BOX_FIGURES = ("ap50", "box_ap50"), ("ap25", "ap50")
"""Of masks and boxes in pictures, and of 3-D boxes."""
NOT_RUN, NOT_SHOWN, WITHIN_CHANCE, EARLIER = "not run", "no gap shown", "above, within chance", " \u2020"
HEADINGS = (
    "AP50 of masks / boxes; of 3-D boxes at .25 / .5",
    "thesis",
    "earlier commit",
    "now",
    "our goal",
    "below the goal",
)


def summary_table(contents: Mapping[str, Mapping[str, Any]]) -> str:
    """The table.

    Args:
        contents: of the files of results, by name.
    """
    named = {row["table"] for row in ROWS}
    earlier = of_earlier_generator({name: content for name, content in contents.items() if name in named})
    rows = []
    for row in ROWS:
        content = contents.get(row["table"])
        now = None if content is None else _now(row, content)
        told = NOT_RUN if now is None else _with_intervals(row, content or {}, now)
        told += EARLIER if now is not None and row["table"] in earlier else ""
        thesis = "-" if "thesis" not in row else _written(row, row["thesis"])
        rows.append(
            [
                row["what"],
                thesis,
                _pair(row, row.get("earlier")),
                told,
                _pair(row, row.get("goal")),
                _short(row, content, now),
            ]
        )
    return table(list(HEADINGS), rows, "---:")


def _now(row: Mapping[str, Any], content: Mapping[str, Any]) -> list[float | None] | None:
    """Today's figures: masks and boxes, or 3-D boxes at .25 and .5; None for a world that is not among the results."""
    if row["kind"] in SHARES:
        table_and_gap = _gap_of(row, content)
        if table_and_gap is None and row["kind"] == "loop":
            return None
        return [None if table_and_gap is None else gap_share(*table_and_gap, figure) for figure in FIGURES]
    if row["kind"] == "gain":
        last = content["size"]["rounds"]
        names = ("mask_ap50", "box_ap50")
        return [_less(loop_values(content, last, "test", name), content["before"].get(name)) for name in names]
    if row["kind"] == "ap50":
        (runs,) = (one for one in content["rows"] if one["name"] == row["row"])
        found = [values(runs, figure) for figure in FIGURES]
        return [float(np.mean(one)) if one else None for one in found]
    if row["world"] not in content["worlds"]:
        return None
    return [_of_ceiling(row, content, figure)[0] for figure in BOX_FIGURES]


def _gap_of(row: Mapping[str, Any], content: Mapping[str, Any]) -> tuple[Mapping[str, Any], Gap] | None:
    """The table and the gap in it whose share is told; None where there is none: small tables lack rows."""
    if row["kind"] == "loop":
        last = loop_table(content)
        return None if last is None else (last, LOOP_GAP)
    if row["kind"] != "share":
        return None
    gap: Gap = row.get("gap", GAP)
    return (content, gap) if set(gap) <= {one["name"] for one in content["rows"]} else None


def _less(after: list[float], before: float | None) -> float | None:
    return float(np.mean(after)) - 100.0 * before if after and before is not None else None


def _of_ceiling(
    row: Mapping[str, Any], content: Mapping[str, Any], figure: str
) -> tuple[float | None, tuple[float, float] | None]:
    """What 3-D boxes reach that labels have taught, of those taught by ground truth, with its interval."""
    world = content["worlds"][row["world"]]
    found = {one["name"]: one for one in world["rows"] if one["boxes"] == "recorded"}
    scenes = len(set(world["pools"]["wide"].get("scenes", ()))) if "pools" in world else 0
    return ratio_to_ceiling(found[SHARED], found[CEILING], figure, scenes)


def _written(row: Mapping[str, Any], value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.1f}" if row["kind"] in ("gain", "ap50") else f"{value:.2f}"


def _pair(row: Mapping[str, Any], pair: list[float | None] | None) -> str:
    return "-" if pair is None else " / ".join(_written(row, one) for one in pair)


def _with_intervals(row: Mapping[str, Any], content: Mapping[str, Any], now: list[float | None]) -> str:
    told = [_within(row, *one) for one in zip(now, _intervals(row, content), strict=True)]
    table_and_gap = _gap_of(row, content)
    if table_and_gap is not None:
        for number, (figure, value) in enumerate(zip(FIGURES, now, strict=True)):
            if value is None and gap_interval(*table_and_gap, figure) is not None:
                told[number] = NOT_SHOWN
    return " / ".join(told)


def _intervals(row: Mapping[str, Any], content: Mapping[str, Any]) -> list[tuple[float, float] | None]:
    """Of today's figures, where results tell of draws."""
    if row["kind"] == "boxes":
        return [_of_ceiling(row, content, figure)[1] for figure in BOX_FIGURES]
    if row["kind"] == "ap50":
        return [row_interval(content, row["row"], figure) for figure in FIGURES]
    table_and_gap = _gap_of(row, content)
    if table_and_gap is not None:
        return [share_interval(*table_and_gap, figure) for figure in FIGURES]
    return [None, None]


def _within(row: Mapping[str, Any], value: float | None, between: tuple[float, float] | None) -> str:
    return _written(row, value) + ("" if between is None else f" [{', '.join(_written(row, one) for one in between)}]")


def _short(row: Mapping[str, Any], content: Mapping[str, Any] | None, now: list[float | None] | None) -> str:
    """By how much today's figures are below the goals; reached is one that the whole interval is above."""
    if "goal" not in row or content is None or now is None:
        return "-"
    short = []
    for value, goal, between in zip(now, row["goal"], _intervals(row, content), strict=True):
        if value is None or goal is None:
            short.append("-")
        elif value < goal - 1e-9:
            short.append(_written(row, goal - value))
        else:
            short.append("reached" if between is None or between[0] >= goal else WITHIN_CHANCE)
    return " / ".join(short)
