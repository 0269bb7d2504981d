"""The picture of the page about predicted views."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt

from experiments.figures.style import PALETTE, save, seed_dots, tidy


def draw_view_prediction(content: Mapping[str, Any], path: Path) -> None:
    """Draws the mean absolute error of every method that predicts pictures, by the number of views given.

    Args:
        content: of ``view_prediction.json``.
        path: PNG to write.
    """
    rows, inputs = content["rows"], content["settings"]["inputs"]
    counts = list(rows[0]["objects"])
    figure, axes = plt.subplots(1, len(counts), figsize=(8.5, 3.4), dpi=110, layout="constrained", sharey=True)
    pictured = [row for row in rows if "l1" in row["objects"][counts[0]][str(inputs[0])]["mean"]]
    for panel, objects in zip(np.atleast_1d(axes), counts, strict=True):
        for place, name in enumerate(dict.fromkeys(row["name"] for row in pictured)):
            runs = [row["objects"][objects] for row in pictured if row["name"] == name]
            errors = [[one[str(count)]["mean"]["l1"] for one in runs] for count in inputs]
            places = list(range(len(inputs)))
            panel.plot(places, [np.mean(one) for one in errors], "o-", ms=4, color=PALETTE[place], label=name)
            for at, values in zip(places, errors, strict=True):
                seed_dots(panel, at, values)
        panel.set_xticks(range(len(inputs)), [str(count) for count in inputs])
        panel.set_xlabel("views given")
        panel.set_title(f"{objects} objects", fontsize=9)
        tidy(panel)
    first = np.atleast_1d(axes)[0]
    first.set_ylim(bottom=0)  # once all panels are drawn: they share the axis, and this ends its scaling
    first.set_ylabel("mean absolute error of colours")
    first.legend(frameon=False, fontsize=8)
    save(figure, path)
