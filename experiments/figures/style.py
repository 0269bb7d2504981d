"""What all plots share: colours, the look of axes, bars with a dot for each seed, and how they are saved."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

matplotlib.use("Agg")

INK, GRID = "#1f2328", "#d8dee4"
GREY, GREEN, BLUE = "#8a94a0", "#137a3e", "#2f5fb3"
PALETTE = (
    *(GREY, GREEN, BLUE, "#c26a12", "#7a3e9d", "#b3372f"),
    *("#2a9d9d", "#c9a227", "#e58fb0", "#5b4a3f", "#9acd58", "#1f2d3d"),
)
"""Of rows: as many as the table with most of them has, and some more."""


def tidy(axes: Axes, grid: bool = True) -> None:
    """Takes away the frame but for the axes; with horizontal lines behind the data."""
    axes.spines[["top", "right"]].set_visible(False)
    if grid:
        axes.grid(axis="y", color=GRID, lw=0.6)
        axes.set_axisbelow(True)


def bar_with_seeds(
    axes: Axes, x: float, values: Sequence[float], width: float, colour: Any, label: str | None = None
) -> None:
    """A bar as high as the mean, with a small black dot for each seed; no height where there are no values."""
    axes.bar(x, float(np.mean(values)) if values else 0.0, width, color=colour, label=label)
    axes.plot([x] * len(values), values, ".", color="black", markersize=2.5)


def seed_dots(axes: Axes, x: float, values: Sequence[float]) -> None:
    """A dot for each of several seeds."""
    if len(values) > 1:
        axes.plot(np.full(len(values), x), values, "o", color=INK, ms=3, alpha=0.7)


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as PNG and closes it."""
    figure.savefig(path, format="png")
    plt.close(figure)
