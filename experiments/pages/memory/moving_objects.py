"""The page about what moves, of the experiment ``moving_objects``."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

from experiments.pages.markdown import Pictures, mean_std, read_result, render, table
from labeling.core.errors import SbmError

PAGE = "moving-objects.md"
FIGURES = {"ap25": "AP .25", "ap50": "AP .5", "bev25": "AP .25 from above", "bev50": "AP .5 from above"}
ERRORS = {"moving_m": "where things move", "zero_m": "there, if nothing is said to move", "standing_m": "elsewhere"}


def compose(results: Path) -> tuple[str, Pictures]:
    """The page; it has no pictures."""
    content = read_result(results / "moving_objects.json")
    if content is None:
        raise SbmError(f"{results}: no moving_objects.json; run this experiment first")
    return page(content), {}


def page(content: Mapping[str, Any]) -> str:
    """The text of the page.

    Args:
        content: of ``moving_objects.json``.
    """
    return render(
        "moving-objects.md.jinja",
        content=content,
        precision=_precision(content),
        recall=_recall(content),
        errors=_errors(content),
    )


def _names(content: Mapping[str, Any]) -> list[str]:
    return list(dict.fromkeys(row["name"] for row in content["rows"]))


def _of(content: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    return [row for row in content["rows"] if row["name"] == name]


def _precision(content: Mapping[str, Any]) -> str:
    rows = []
    for name in _names(content):
        runs = _of(content, name)
        cells = [mean_std([100 * row[figure] for row in runs if row[figure] is not None]) for figure in FIGURES]
        rows.append([name, *cells, mean_std([row["boxes"] / row["pairs"] for row in runs])])
    return table(["method", *FIGURES.values(), "boxes in a pair"], rows, "---:")


def _recall(content: Mapping[str, Any]) -> str:
    bins = content["rows"][0]["recall"]
    ends = [f"{one['from_m']:g} to {after['from_m']:g} m" for one, after in pairwise(bins)]
    ends.append(f"{bins[-1]['from_m']:g} m and more")
    heads = [f"{end} ({one['objects']})" for end, one in zip(ends, bins, strict=True)]
    rows = []
    for name in _names(content):
        shares = [[row["recall"][number]["recall"] for row in _of(content, name)] for number in range(len(bins))]
        rows.append([name, *(mean_std([100 * one for one in values if one is not None]) for values in shares)])
    return table(["method", *heads], rows, "---:")


def _errors(content: Mapping[str, Any]) -> str:
    rows = []
    for name in _names(content):
        runs = [row for row in _of(content, name) if "moving_m" in row]
        if runs:
            rows.append([name, *(mean_std([100 * row[figure] for row in runs]) for figure in ERRORS)])
    return table(["error of flow, cm", *ERRORS.values()], rows, "---:")
