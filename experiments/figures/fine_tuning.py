"""AP50 of detectors that learnt from labels, with one kind of error after the other mended."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import BLUE, GREEN, GREY, save, seed_dots, tidy

COLOURS = (GREEN, "#5a9e74", "#6f8fbf", BLUE)
"""Of what is learnt from, from labels to ground truth."""
FIGURES = {"mask_ap50": "masks", "box_ap50": "boxes"}
STEP = 5.0
"""The axis begins at the last multiple of this below the detector before."""


def draw_fine_tuning(contents: Sequence[Mapping[str, Any]], teachers: Mapping[str, str], path: Path) -> None:
    """Draws AP50 in dev scenes: a row for each world, masks beside boxes.

    Bars are means, dots seeds, a line the detector before.

    Args:
        contents: of ``fine_tuning.json`` and ``fine_tuning_streets.json``.
        teachers: what a detector was fine-tuned on, and what its bar is called.
        path: PNG to write.
    """
    figure, panels = plt.subplots(
        len(contents), len(FIGURES), figsize=(9.6, 2.9 * len(contents)), dpi=100, sharey="row", squeeze=False
    )
    for row, content in zip(panels, contents, strict=True):
        for axes, (key, name) in zip(row, FIGURES.items(), strict=True):
            _panel(axes, content, teachers, key)
            axes.set_title(f"{content['world']}: {name}", fontsize=10)
        shown = [value for axes in row for value in axes.dataLim.intervaly if value > 0]
        lowest = STEP * np.floor(max(0.0, min(_before(content)) - STEP / 2) / STEP)
        row[0].set_ylim(lowest, lowest + 1.15 * max(max(shown) - lowest, 1.0))
        row[0].set_ylabel("AP50, points")
        row[0].legend(frameon=False, fontsize=8, loc="lower right")
    figure.tight_layout()
    save(figure, path)


def _panel(axes: Axes, content: Mapping[str, Any], teachers: Mapping[str, str], key: str) -> None:
    for x, (teacher, colour) in enumerate(zip(teachers, COLOURS, strict=True)):
        values = [100 * run["dev"][key] for run in content["runs"] if run["teacher"] == teacher]
        axes.bar(x, float(np.mean(values)), 0.7, color=colour)
        seed_dots(axes, x, values)
        axes.annotate(f"{np.mean(values):.1f}", (x, max(values)), ha="center", va="bottom", fontsize=8)
    axes.axhline(100 * content["before"]["dev"][key], color=GREY, lw=1.2, ls="--", label="before")
    axes.set_xticks(range(len(teachers)), [name.replace(", ", ",\n") for name in teachers.values()], fontsize=8)
    tidy(axes)


def _before(content: Mapping[str, Any]) -> list[float]:
    return [100 * content["before"]["dev"][key] for key in FIGURES]
