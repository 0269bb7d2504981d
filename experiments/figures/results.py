"""Pictures of the page of results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from experiments.figures.result_values import loop_values, values
from experiments.figures.style import BLUE, GREEN, GREY, GRID, PALETTE, bar_with_seeds, save, tidy

LEGEND_IN = 3.4
"""Room beside the bars for the names of rows, inches."""


MOST_BARS = 5
"""Rows that are told apart as bars beside each other; more are drawn below each other, under their names."""
PANELS_IN_A_ROW = 5


def draw_categories(content: Mapping[str, Any], categories: Sequence[str], path: Path) -> None:
    """AP50 of all categories and of each, one bar for each row, with a dot for each seed.

    Args:
        content: of a table's result.
        categories: to draw.
        path: PNG to write.
    """
    draw = _draw_bars if len(content["rows"]) <= MOST_BARS else _draw_panels
    draw(content, [None, *categories], path)


def _draw_panels(content: Mapping[str, Any], groups: Sequence[str | None], path: Path) -> None:
    """A panel for each group, in which rows lie below each other."""
    rows, across = content["rows"], min(len(groups), PANELS_IN_A_ROW)
    down = -(-len(groups) // across)
    size_in = LEGEND_IN + 1.6 * across, down * (0.45 + 0.21 * len(rows)) + 0.3
    figure, grid = plt.subplots(
        down, across, figsize=size_in, dpi=110, sharex=True, sharey=True, squeeze=False, layout="constrained"
    )
    for axes, group in zip(grid.flat, groups, strict=False):
        for number, row in enumerate(rows):
            found = values(row, "ap50", group)
            if found:
                axes.barh(number, np.mean(found), 0.72, color=PALETTE[number % len(PALETTE)])
                axes.plot(found, [number] * len(found), ".", color="black", markersize=3)
        axes.set_title(group or "all", fontsize=9)
        tidy(axes, grid=False)
        axes.grid(axis="x", color=GRID, lw=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8, labelbottom=True)
    for axes in grid.flat[len(groups) :]:
        axes.set_axis_off()
    first = grid[0, 0]
    first.set_yticks(range(len(rows)), [row["name"] for row in rows])
    first.set_ylim(len(rows) - 0.5, -0.5)
    first.set_xlim(0, 100)
    figure.supxlabel("AP50", fontsize=9)
    save(figure, path)


def _draw_bars(content: Mapping[str, Any], groups: Sequence[str | None], path: Path) -> None:
    """Bars of all rows beside each other, group by group."""
    bars_in = max(6.0, len(groups) * (0.4 + 0.11 * len(content["rows"])))
    figure, axes = plt.subplots(figsize=(bars_in + LEGEND_IN, 3.4), dpi=110, layout="constrained")
    width = 0.8 / len(content["rows"])
    for number, row in enumerate(content["rows"]):
        colour, offset = PALETTE[number % len(PALETTE)], (number - (len(content["rows"]) - 1) / 2) * width
        for place, category in enumerate(groups):
            name = row["name"] if place == 0 else None
            bar_with_seeds(axes, place + offset, values(row, "ap50", category), width, colour, name)
    axes.set_xticks(range(len(groups)), [group or "all" for group in groups])
    axes.set_ylabel("AP50")
    axes.set_ylim(0, 100)
    tidy(axes, grid=False)
    figure.legend(fontsize=8, frameon=False, loc="outside right upper")
    save(figure, path)


CURVES = {
    "labels, on the views they are of": ("labels", "pseudo_labels", "mask_ap50"),
    "detector after it, unseen scenes": ("test", "mask_ap50"),
    "taught by ground truth": ("ceiling", "mask_ap50"),
    "detector after it, photographs": ("test", "photographs_ap50"),
}


def draw_loop(content: Mapping[str, Any], path: Path) -> None:
    """AP50 by round: mean over seeds, from the lowest to the highest seed in shade.

    Args:
        content: of a loop's result.
        path: PNG to write.
    """
    figure, axes = plt.subplots(figsize=(7.0, 3.6), dpi=110, layout="constrained")
    before = content["before"]
    for number, (name, place) in enumerate(CURVES.items(), start=1):
        found = {one: loop_values(content, one, *place) for one in range(1, content["size"]["rounds"] + 1)}
        found = {one: points for one, points in found.items() if points}
        if not found:
            continue
        if place[0] != "labels":
            found = {0: [100 * before[place[-1]]], **found}
        rounds, colour = list(found), PALETTE[number]
        axes.plot(rounds, [np.mean(one) for one in found.values()], "o-", color=colour, label=name)
        low, high = ([pick(one) for one in found.values()] for pick in (min, max))
        axes.fill_between(rounds, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.set_xticks(range(content["size"]["rounds"] + 1))
    axes.set_xlabel("round")
    axes.set_ylabel("AP50")
    tidy(axes, grid=False)
    figure.legend(fontsize=8, frameon=False, ncols=3, loc="outside upper center")
    save(figure, path)


BOX_COLOURS = {
    "LDLS": GREY,
    "LDLS, tuned": "#b9c0c8",
    "SbM F-PointNet": "#8cc5a2",
    "SbM F-PointNet on shared labels": GREEN,
    "supervised F-PointNet": BLUE,
}


def draw_boxes_3d(content: Mapping[str, Any], mask_sources: Mapping[str, str], path: Path) -> None:
    """AP25 and AP50 of 3-D boxes by world and by where 2-D detections come from, one bar for each row.

    Args:
        content: of ``table_5_5.json``.
        mask_sources: where 2-D detections come from, and what that is called.
        path: PNG to write.
    """
    groups = [(world, source) for world in content["worlds"] for source in mask_sources]
    figure, panels = plt.subplots(2, figsize=(8.0, 5.4), dpi=110, sharex=True, layout="constrained")
    for axes, measure, at in zip(panels, ("ap25", "ap50"), (".25", ".5"), strict=True):
        for place, (world, source) in enumerate(groups):
            rows = [row for row in content["worlds"][world]["rows"] if row["boxes"] == source]
            width = 0.8 / len(rows)
            for number, row in enumerate(rows):
                x, label = place + (number - (len(rows) - 1) / 2) * width, row["name"] if place == 0 else None
                found = [100.0 * run[measure] for run in row["runs"] if run[measure] is not None]
                bar_with_seeds(axes, x, found, width, BOX_COLOURS[row["name"]], label)
        axes.set_ylabel(f"AP of 3-D boxes at {at}")
        axes.set_ylim(0, 100)
        tidy(axes)
    names = [f"{world},\n2-D boxes {mask_sources[source]}" for world, source in groups]
    panels[-1].set_xticks(range(len(groups)), names, fontsize=8)
    panels[0].legend(fontsize=8, frameon=False, ncols=3, loc="upper left")
    save(figure, path)
