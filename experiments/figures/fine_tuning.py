"""AP50 before and after fine-tuning."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import BLUE, GREEN, GREY, save, seed_dots, tidy

COLOURS = {"before": GREY, "labels": GREEN, "truth": BLUE}
SETS = {"validation": "validation scenes", "photographs": "photographs"}


def draw_fine_tuning(content: Mapping[str, Any], teachers: Mapping[str, str], path: Path) -> None:
    """Draws AP50 before and after: a panel for each world, bars for means, dots for seeds.

    Args:
        content: of ``fine_tuning.json``.
        teachers: what a detector was fine-tuned on, and its name in the legend.
        path: PNG to write.
    """
    worlds = content["worlds"]
    figure, panels = plt.subplots(1, len(worlds), figsize=(4.6 * len(worlds), 3.4), dpi=100, sharey=True, squeeze=False)
    names = {"before": "before", **{teacher: f"after {name}" for teacher, name in teachers.items()}}
    for axes, (world, found) in zip(panels[0], worlds.items(), strict=True):
        _panel(axes, found, names)
        axes.set_title(world, fontsize=10)
    panels[0][0].set_ylabel("AP50, per cent")
    panels[0][0].legend(frameon=False, fontsize=8, loc="upper left")
    figure.tight_layout()
    save(figure, path)


def _panel(axes: Axes, world: Mapping[str, Any], names: Mapping[str, str]) -> None:
    for group, part in enumerate(SETS):
        for place, (teacher, name) in enumerate(names.items()):
            runs = [world["before"]] if teacher == "before" else [r for r in world["runs"] if r["teacher"] == teacher]
            values = [100 * run[part]["mask_ap50"] for run in runs]
            x, mean = group + 0.26 * (place - 1), float(np.mean(values))
            axes.bar(x, mean, 0.24, color=COLOURS[teacher], label=name if group == 0 else None)
            seed_dots(axes, x, values)
            axes.annotate(f"{mean:.1f}", (x, max(values)), ha="center", va="bottom", fontsize=7.5)
    axes.set_xticks(range(len(SETS)), list(SETS.values()))
    axes.set_ylim(0, 105)
    tidy(axes)
