"""Pictures of the page of results."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot as plt

from experiments.figures.result_values import loop_values, values

matplotlib.use("Agg")

COLOURS = (
    "#8a94a0",
    "#137a3e",
    "#2f5fb3",
    "#c26a12",
    "#7a3e9d",
    "#b3372f",
    "#2a9d9d",
    "#c9a227",
    "#e58fb0",
    "#5b4a3f",
    "#9acd58",
    "#1f2d3d",
)
"""Of rows; as many as the table with most of them has, and some more."""
LEGEND_IN = 3.4
"""Room beside the bars for the names of rows, inches."""


def draw_categories(content: Mapping[str, Any], categories: Sequence[str], path: Path) -> None:
    """AP50 of all categories and of each, one bar for each row, with a dot for each seed.

    Args:
        content: of a table's result.
        categories: to draw.
        path: PNG to write.
    """
    groups = [None, *categories]
    bars_in = max(6.0, len(groups) * (0.4 + 0.11 * len(content["rows"])))
    figure, axes = plt.subplots(figsize=(bars_in + LEGEND_IN, 3.4), dpi=110, layout="constrained")
    width = 0.8 / len(content["rows"])
    for number, row in enumerate(content["rows"]):
        places = np.arange(len(groups)) + (number - (len(content["rows"]) - 1) / 2) * width
        found = [values(row, "ap50", category) for category in groups]
        axes.bar(
            places,
            [float(np.mean(one)) if one else 0.0 for one in found],
            width,
            color=COLOURS[number % len(COLOURS)],
            label=row["name"],
        )
        for place, one in zip(places, found, strict=True):
            axes.plot([place] * len(one), one, ".", color="black", markersize=2.5)
    axes.set_xticks(range(len(groups)), ["all", *categories])
    axes.set_ylabel("AP50")
    axes.set_ylim(0, 100)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(fontsize=8, frameon=False, loc="outside right upper")
    figure.savefig(path, format="png")
    plt.close(figure)


CURVES = {
    "labels, on the views so far": ("labels", "pseudo_labels", "mask_ap50"),
    "detector after it, unseen scenes": ("test", "mask_ap50"),
    "detector after it, photographs": ("test", "photographs_ap50"),
}


def draw_loop(content: Mapping[str, Any], path: Path) -> None:
    """AP50 by round: mean over seeds, from the lowest to the highest seed in shade.

    Args:
        content: of a loop's result.
        path: PNG to write.
    """
    figure, axes = plt.subplots(figsize=(7.0, 3.6), dpi=110, layout="constrained")
    before = {
        "detector after it, unseen scenes": 100 * content["before"]["mask_ap50"],
        "detector after it, photographs": 100 * content["before"]["photographs_ap50"],
    }
    for number, (name, place) in enumerate(CURVES.items(), start=1):
        found = {one: loop_values(content, one, *place) for one in range(1, content["size"]["rounds"] + 1)}
        if name in before:
            found = {0: [before[name]], **found}
        found = {one: points for one, points in found.items() if points}
        rounds, colour = list(found), COLOURS[number]
        axes.plot(rounds, [np.mean(one) for one in found.values()], "o-", color=colour, label=name)
        low, high = ([pick(one) for one in found.values()] for pick in (min, max))
        axes.fill_between(rounds, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.set_xticks(range(content["size"]["rounds"] + 1))
    axes.set_xlabel("round")
    axes.set_ylabel("AP50")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(fontsize=8, frameon=False, ncols=3, loc="outside upper center")
    figure.savefig(path, format="png")
    plt.close(figure)
