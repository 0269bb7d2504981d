"""Time of labelling over the number of views."""

from collections.abc import Mapping
from pathlib import Path

from matplotlib import pyplot as plt

from experiments.figures.style import save, tidy

PICTURE = "labels_views.png"


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
