"""Figures of policies as cells of a table."""

from collections.abc import Mapping
from typing import Any

from agents.evaluation.statistics import shown_sign
from experiments.pages.markdown import table

PERCENT = 100


def figures_table(headings: Mapping[str, tuple[str, float]], policies: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of figures with their deviation, one row for each policy; bold where the difference is shown.

    Args:
        headings: by figure, its heading and what it is multiplied with.
        policies: by policy its figures, as ``agents.evaluation`` sums them up.
    """
    rows = [
        [f"`{policy}`", *(cell(figures.get(name), factor) for name, (_, factor) in headings.items())]
        for policy, figures in policies.items()
    ]
    return table(["", *(heading for heading, _ in headings.values())], rows)


def cell(figure: Mapping[str, Any] | None, factor: float = 1) -> str:
    """Mean and deviation of a figure; bold where its difference is shown.

    Args:
        figure: as ``agents.evaluation`` sums it up.
        factor: to multiply it with.
    """
    if figure is None or figure["mean"] is None:
        return "-"
    digits = 1 if factor == PERCENT else 2
    mean, std = f"{factor * figure['mean']:.{digits}f}", figure["std"]
    difference = figure.get("difference")
    if shown_sign(difference):
        mean = f"**{mean}**"
    return mean if std is None else f"{mean} ± {factor * std:.{digits}f}"


def interval(difference: Mapping[str, Any] | None, factor: float = 1) -> str:
    """A difference with its interval; bold where it is shown."""
    if difference is None:
        return "-"
    digits = 1 if factor == PERCENT else 2
    mean = f"{factor * difference['mean']:+.{digits}f}"
    if difference["low"] is None:
        return mean
    low, high = (f"{factor * difference[name]:+.{digits}f}" for name in ("low", "high"))
    return f"{f'**{mean}**' if shown_sign(difference) else mean} [{low}, {high}]"
