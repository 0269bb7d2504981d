"""The page about noise of depth and poses, of the experiment ``noise``."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from experiments.figures.result_values import widened
from experiments.pages.markdown import Pictures, interval, points, read_result, render, table
from labeling.core.errors import SbmError

PAGE, PICTURE = "sensor-noise.md", "sensor_noise.png"
OF_LABELS = ("noise.json",)
"""Files of results whose figures depend on labels."""
FIGURES = {"mean_iou": "mean IoU", "mask_ap50": "mask AP50", "box_ap50": "box AP50"}


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its picture."""
    from experiments.figures.sensor_noise import draw_sensor_noise

    content = read_result(results / "noise.json")
    if content is None:
        raise SbmError(f"{results}: no noise.json; run this experiment first")
    return page(content), {PICTURE: partial(draw_sensor_noise, content)}


def page(content: Mapping[str, Any]) -> str:
    """The text of the page."""
    first, *others = content["results"]
    scenes = len(set(content["pool"]["scenes"]))
    return render(
        "sensor-noise.md.jinja",
        content=content,
        levels={name: _levels(found, scenes) for name, found in content["results"].items()},
        gains={name: _gains(content["results"][name], scenes) for name in others},
        first=first,
        picture=PICTURE,
    )


def _levels(found: Mapping[str, Any], scenes: int) -> str:
    """Means over homes, and how far each lies from that without noise."""
    headings = ["", *(text for title in FIGURES.values() for text in (title, "from clean"))]
    rows = []
    for kind, one in found.items():
        cells = []
        for figure in FIGURES:
            cells += [points(one["mean"][figure]), interval(widened(one["difference"][figure], scenes))]
        rows.append([kind, *cells])
    return table(headings, rows, "---:")


def _gains(found: Mapping[str, Any], scenes: int) -> str:
    rows = [
        [kind, *(interval(widened(one["gain"][figure], scenes)) for figure in FIGURES)] for kind, one in found.items()
    ]
    return table(["", *FIGURES.values()], rows, "---:")
