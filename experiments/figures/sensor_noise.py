"""The picture of the page about noise."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from experiments.figures.style import INK, PALETTE, save, tidy


def draw_sensor_noise(content: Mapping[str, Any], path: Path) -> None:
    """Draws the mean IoU of each kind of noise with a dot for each home, one bar a treatment.

    Args:
        content: of ``noise.json``.
        path: PNG to write.
    """
    treatments = content["results"]
    kinds = [one["name"] for one in content["kinds"]]
    figure, axes = plt.subplots(figsize=(9.5, 3.8), dpi=110, layout="constrained")
    width = 0.8 / len(treatments)
    for place, (treatment, found) in enumerate(treatments.items()):
        x = np.arange(len(kinds)) + (place + 0.5) * width - 0.4
        axes.bar(x, [100 * found[kind]["mean"]["mean_iou"] for kind in kinds], 0.92 * width, color=PALETTE[place + 1])
        for at, kind in zip(x, kinds, strict=True):
            homes = [100 * value for value in found[kind]["per_episode"]["mean_iou"] if value is not None]
            axes.plot(np.full(len(homes), at), homes, ".", color=INK, ms=2.5)
        axes.plot([], [], "s", color=PALETTE[place + 1], label=treatment)
    if len(treatments) > 1:
        axes.legend(frameon=False, fontsize=8, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=len(treatments))
    axes.set_xticks(range(len(kinds)), [fill(name, 10) for name in kinds], fontsize=7.5)
    axes.set_ylabel("mean IoU of labels, points; a dot is a home")
    tidy(axes)
    save(figure, path)
