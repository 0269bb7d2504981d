"""The pictures of the page about boxes on memories."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import PALETTE, save, seed_dots, tidy

TITLES = {"ap25": "IoU of .25", "ap50": "IoU of .5"}


def draw_by_views(content: Mapping[str, Any], path: Path) -> None:
    """Draws AP of all objects by the number of views given.

    Args:
        content: of ``memory_boxes.json``.
        path: PNG to write.
    """
    inputs, rows = content["settings"]["inputs"], content["rows"]
    lines = list(dict.fromkeys((row["name"], row["labels"]) for row in rows))
    figure, axes = plt.subplots(1, len(TITLES), figsize=(9.5, 3.6), dpi=110, layout="constrained", sharey=True)
    for panel, (score, title) in zip(axes, TITLES.items(), strict=True):
        for name, labels in lines:
            runs = [row["inputs"] for row in rows if (row["name"], row["labels"]) == (name, labels)]
            values = [[run[str(count)]["all"][score] for run in runs] for count in inputs]
            names = list(dict.fromkeys(one for one, _ in lines))
            dashed = labels != lines[0][1]
            _line(panel, values, PALETTE[names.index(name)], dashed, f"{name}, {labels}")
        _finish(panel, title, [str(count) for count in inputs], "views given")
    axes[0].set_ylabel("average precision, %")
    axes[1].legend(frameon=False, fontsize=7)
    save(figure, path)


def draw_by_labels(content: Mapping[str, Any], path: Path) -> None:
    """Draws AP by the share of scenes that are labelled, from the most views.

    Args:
        content: of ``label_fraction.json``.
        path: PNG to write.
    """
    shares, rows, count = content["settings"]["shares"], content["rows"], str(max(content["settings"]["inputs"]))
    lines = list(dict.fromkeys((row["name"], row["beginning"]) for row in rows))
    names = list(dict.fromkeys(name for name, _ in lines))
    figure, axes = plt.subplots(1, len(TITLES), figsize=(9.5, 3.6), dpi=110, layout="constrained", sharey=True)
    for panel, (score, title) in zip(axes, TITLES.items(), strict=True):
        for name, beginning in lines:
            runs = [row for row in rows if (row["name"], row["beginning"]) == (name, beginning)]
            values = [
                [row["inputs"][count]["shown"][score] for row in runs if row["share"] == share] for share in shares
            ]
            dashed = beginning == lines[0][1]
            _line(panel, values, PALETTE[names.index(name)], dashed, f"{name} {beginning}")
        _finish(panel, title, [f"{100 * share:g} %" for share in shares], "scenes labelled")
    axes[0].set_ylabel("average precision, %")
    axes[1].legend(frameon=False, fontsize=7)
    save(figure, path)


def _line(panel: Axes, values: Sequence[Sequence[float | None]], colour: Any, dashed: bool, label: str) -> None:
    percents = [[100 * (one or 0.0) for one in of_seeds] for of_seeds in values]
    means = [float(np.mean(one)) for one in percents]
    panel.plot(range(len(means)), means, "o--" if dashed else "o-", ms=4, color=colour, label=label)
    for place, some in enumerate(percents):
        seed_dots(panel, place, some)


def _finish(panel: Axes, title: str, ticks: Sequence[str], below: str) -> None:
    panel.set_xticks(range(len(ticks)), ticks)
    panel.set_xlabel(below)
    panel.set_title(title, fontsize=9)
    panel.set_ylim(bottom=0)
    tidy(panel)
