"""The plot of an evaluation: return and labels by number of views."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

from labeling.formats.atomic import atomic_file

COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22")
LABEL_PANELS = {
    "pooled_ap50": "AP50 of the labels\n(on the views spent)",
    "right": "right labels\nan episode",
    "objects": "objects with a right label\nan episode",
}


def draw_summary(content: dict[str, Any], path: Path) -> None:
    """Draws return, sectors and label quality over the views spent; bands are one standard deviation over seeds.

    Args:
        content: of ``evaluation.json``.
        path: PNG to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    policies = content["policies"]
    panels = {"return": "return", "sectors": "sectors seen\nof confirmed objects"}
    if all(found["labels"] for found in policies.values()):
        panels |= LABEL_PANELS
    figure = Figure(figsize=(3.5 * len(panels), 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(1, len(panels))
    for axes, (name, title) in zip(rows, panels.items(), strict=True):
        for (policy, found), colour in zip(policies.items(), itertools.cycle(COLOURS), strict=False):
            views, means, spreads = _series(found, name)
            marker = "o" if name in LABEL_PANELS else None
            axes.plot(views, means, color=colour, label=policy, marker=marker, markersize=4, linewidth=1.6)
            if spreads is not None:
                axes.fill_between(views, means - spreads, means + spreads, color=colour, alpha=0.18, linewidth=0)
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("views spent")
        axes.set_xlim(left=0)
        axes.grid(alpha=0.25, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    settings = content["settings"]
    figure.suptitle(
        f"{settings['env']}, {settings['split']} scenes, {settings['detector']} detector, "
        f"{settings['episodes']} episodes x {len(settings['seeds'])} seeds",
        fontsize=10,
    )
    handles, names = rows[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=min(6, len(names)), frameon=False, fontsize=9)
    with atomic_file(path) as temporary:
        figure.savefig(temporary, format="png")


def _series(found: dict[str, Any], name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Views, means, and standard deviations where there are several seeds."""
    if name in LABEL_PANELS:
        counts = sorted(found["labels"], key=int)
        cells = [found["labels"][count][name] for count in counts]
        means, spreads = (np.array([cell[figure] for cell in cells], float) for figure in ("mean", "std"))
        return np.array(counts, int), means, None if np.isnan(spreads).any() else spreads
    curve = found["curves"][name]
    means = np.array(curve["mean"])
    return np.arange(1, len(means) + 1), means, None if curve["std"] is None else np.array(curve["std"])
