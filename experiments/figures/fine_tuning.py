"""AP50 of detectors that learnt from labels, with one kind of error after the other mended, and from ground truth."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import BLUE, GREEN, INK, save, tidy

FIGURES = {"mask_ap50": "masks", "box_ap50": "boxes"}
BETWEEN = "#6f8fbf"
"""Colour of labels that ground truth has mended in part."""


def draw_fine_tuning(contents: Sequence[Mapping[str, Any]], teachers: Mapping[str, str], path: Path) -> None:
    """Draws AP50 in dev scenes: a row of panels for each world, masks beside boxes.

    Bars are means, dots seeds, a line the detector before.

    Args:
        contents: of ``fine_tuning.json`` and ``fine_tuning_streets.json``.
        teachers: what a detector was fine-tuned on, and what its bar is called; from top to bottom.
        path: PNG to write.
    """
    figure, panels = plt.subplots(
        len(contents), len(FIGURES), figsize=(9.6, 0.5 + 3.2 * len(contents)), dpi=100, sharey=True, squeeze=False
    )
    for row, content in zip(panels, contents, strict=True):
        for axes, (key, name) in zip(row, FIGURES.items(), strict=True):
            _panel(axes, content, teachers, key)
            axes.set_title(f"{content['world']}: {name}", fontsize=10, pad=16)
    panels[0][0].invert_yaxis()
    figure.tight_layout()
    save(figure, path)


def _panel(axes: Axes, content: Mapping[str, Any], teachers: Mapping[str, str], key: str) -> None:
    for y, (teacher, name) in enumerate(teachers.items()):
        values = [100 * run["dev"][key] for run in content["runs"] if run["teacher"] == teacher]
        if not values:
            continue
        colour = BLUE if name.startswith("ground truth") else BETWEEN if "no false" in name else GREEN
        axes.barh(y, float(np.mean(values)), 0.7, color=colour)
        if len(values) > 1:
            axes.plot(values, np.full(len(values), y), "o", color=INK, ms=3, alpha=0.7)
        axes.annotate(f"{np.mean(values):.1f}", (max(values) + 1, y), ha="left", va="center", fontsize=8)
    before = 100 * content["before"]["dev"][key]
    axes.axvline(before, color="black", lw=1.2, ls="--")
    axes.annotate("before", (before, 1), xycoords=("data", "axes fraction"), ha="center", va="bottom", fontsize=8)
    axes.set_yticks(range(len(teachers)), list(teachers.values()), fontsize=8)
    axes.set_xlim(0, 1.12 * axes.dataLim.x1)
    axes.set_xlabel("AP50, points")
    tidy(axes, grid=False)
