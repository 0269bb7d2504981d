"""The pictures of the page about the label generator: its ablation, and the time of labelling."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib import pyplot as plt

from agents.evaluation.statistics import significant_sign
from experiments.figures.result_values import widened
from experiments.figures.style import GREEN, GREY, GRID, INK, save, tidy

ROW_IN = 0.235
COLOURS = {1: GREEN, -1: "#b42318", 0: GREY}
"""Of variants that are better, worse, and neither beyond chance."""
PANELS = {"mean_iou": "mean IoU", "mask_ap50": "AP50"}


def draw_label_ablation(content: dict[str, Any], pool: str, path: Path) -> None:
    """Draws every variant's difference from the default with its interval, one row a variant.

    Args:
        content: of ``label_ablation.json``.
        pool: the episodes to show.
        path: PNG to write.
    """
    rows: list[tuple[str, dict[str, Any] | None]] = []
    scenes = len(set(content["pools"][pool]["scenes"]))
    for factor in content["factors"]:
        if factor["variants"]:
            rows.append((factor["title"], None))
            rows += [(one["name"], one["results"][pool]["difference"]) for one in factor["variants"]]
    figure, panels = plt.subplots(
        1, len(PANELS), sharey=True, figsize=(10, 1.0 + ROW_IN * len(rows)), dpi=100, squeeze=False
    )
    for axes, (key, title) in zip(panels[0], PANELS.items(), strict=True):
        for place, (_, differences) in enumerate(rows):
            difference = None if differences is None else widened(differences[key], scenes)
            if difference is not None:
                colour = COLOURS[significant_sign(difference)]
                if difference["low"] is not None:
                    ends = [100 * difference["low"], 100 * difference["high"]]
                    axes.plot(ends, [place, place], color=colour, lw=2.2, solid_capstyle="round")
                axes.plot([100 * difference["mean"]], [place], "o", color=colour, ms=5)
        axes.axvline(0, color=INK, lw=0.8)
        # Large losses are few, and would press all the others into a line: beyond 20 points a linear scale gives way.
        axes.set_xscale("symlog", linthresh=5, linscale=1.5)
        ticks = [-50, -20, -10, -5, -2, 0, 2, 5]
        axes.set_xticks(ticks, [f"{tick:+d}" if tick else "0" for tick in ticks])
        axes.minorticks_off()
        axes.set_title(f"{title}: points above the default", fontsize=9.5)
        axes.grid(axis="x", color=GRID, lw=0.6)
        axes.tick_params(axis="x", labelsize=8)
        axes.set_axisbelow(True)
        axes.spines["left"].set_visible(False)
        tidy(axes, grid=False)
    first = panels[0][0]
    first.set_yticks(range(len(rows)), [name for name, _ in rows], fontsize=8)
    for text, (_, differences) in zip(first.get_yticklabels(), rows, strict=True):
        text.set_fontweight("bold" if differences is None else "normal")
    first.set_ylim(len(rows) - 0.5, -0.5)
    first.tick_params(axis="y", length=0)
    panels[0][-1].tick_params(axis="y", length=0)
    figure.tight_layout()
    save(figure, path)


def draw_label_speed(seconds_per_view: Mapping[int, float], path: Path) -> None:
    """Draws the time for each view over the number of views.

    Args:
        seconds_per_view: by the number of views of an episode.
        path: PNG to write.
    """
    figure, axes = plt.subplots(figsize=(5.2, 3.4), dpi=120, layout="constrained")
    axes.plot(list(seconds_per_view), [1e3 * one for one in seconds_per_view.values()], "o-", color="#0f766e")
    axes.set_xlabel("views of the episode (320x240, ten objects)")
    axes.set_ylabel("labelling, ms for each view")
    axes.set_ylim(0, None)
    axes.set_xlim(0, None)
    axes.grid(alpha=0.3)
    tidy(axes, grid=False)
    save(figure, path)
