"""AP50 before and after fine-tuning."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import BLUE, GREEN, GREY, save, seed_dots, tidy

COLOURS = {"labels": GREEN, "truth": BLUE}
FIGURES = {"mask_ap50": "masks", "box_ap50": "boxes"}


def draw_fine_tuning(content: Mapping[str, Any], teachers: Mapping[str, str], path: Path) -> None:
    """Draws AP50 in dev scenes: a panel for each world and for masks and boxes, a pair of bars for each way of
    training, dots for seeds, a line for the detector before.

    Args:
        content: of ``fine_tuning.json``.
        teachers: what a detector was fine-tuned on, and its name in the legend.
        path: PNG to write.
    """
    worlds, variants = content["worlds"], list(content["variants"])
    rows, columns = len(worlds), len(FIGURES)
    size = (1.6 + 1.5 * len(variants) * columns, 3.0 * rows)
    figure, panels = plt.subplots(rows, columns, figsize=size, dpi=100, sharey="row", squeeze=False)
    for row, (world, found) in zip(panels, worlds.items(), strict=True):
        for axes, (key, name) in zip(row, FIGURES.items(), strict=True):
            _panel(axes, found, variants, teachers, key)
            axes.set_title(f"{world}, {name}", fontsize=10)
        row[0].set_ylabel("AP50, per cent")
    panels[0][0].legend(frameon=False, fontsize=8, loc="lower right")
    figure.tight_layout()
    save(figure, path)


def _panel(axes: Axes, world: Mapping[str, Any], variants: list[str], teachers: Mapping[str, str], key: str) -> None:
    before, highest = 100 * world["before"]["dev"][key], 0.0
    for group, variant in enumerate(variants):
        for place, (teacher, name) in enumerate(teachers.items()):
            runs = [run for run in world["runs"] if (run["variant"], run["teacher"]) == (variant, teacher)]
            values = [100 * run["dev"][key] for run in runs]
            x, mean = group + 0.36 * (place - 0.5), float(np.mean(values))
            axes.bar(x, mean, 0.34, color=COLOURS[teacher], label=name if group == 0 else None)
            seed_dots(axes, x, values)
            axes.annotate(f"{mean:.1f}", (x, max(values)), ha="center", va="bottom", fontsize=7.5)
            highest = max(highest, *values)
    axes.axhline(before, color=GREY, lw=1, ls="--", label="before")
    axes.set_xticks(range(len(variants)), [variant.replace(" ", "\n", 1) for variant in variants], fontsize=8)
    axes.set_ylim(0, 1.15 * max(highest, before, 1.0))
    tidy(axes)
