"""The page about predicted views, of the experiments ``view_prediction`` and ``scene_arithmetic``."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.statistics import paired_record, significant_sign
from experiments.pages.markdown import Pictures, read_result, render, table
from labeling.core.errors import SbmError

PAGE, PICTURE = "view-prediction.md", "view_prediction.png"
FIGURES = {"l1": ("L1", "{:.3f}"), "psnr": ("PSNR, dB", "{:.1f}"), "ssim": ("SSIM", "{:.3f}")}
RETRIEVAL = "view_r1"
OF_ARITHMETIC = {
    "changed_l1": ("L1 where A and the answer differ", "{:.3f}"),
    "l1": FIGURES["l1"],
    "ssim": FIGURES["ssim"],
}


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its picture."""
    from experiments.figures.view_prediction import draw_view_prediction

    content, arithmetic = (read_result(results / f"{name}.json") for name in ("view_prediction", "scene_arithmetic"))
    if content is None:
        raise SbmError(f"{results}: no view_prediction.json; run this experiment first")
    return page(content, arithmetic), {PICTURE: partial(draw_view_prediction, content)}


def page(content: Mapping[str, Any], arithmetic: Mapping[str, Any] | None = None) -> str:
    """The text of the page.

    Args:
        content: of ``view_prediction.json``.
        arithmetic: of ``scene_arithmetic.json``, if there is one.
    """
    objects = list(content["rows"][0]["objects"])
    inputs = [str(one) for one in content["settings"]["inputs"]]
    return render(
        "view-prediction.md.jinja",
        content=content,
        picture=PICTURE,
        tables={count: _figures(content, count, inputs) for count in objects},
        retrieval={count: _retrieval(content, count, inputs) for count in objects},
        leads={count: _leads(content, count, inputs) for count in objects},
        chance=1 / content["settings"]["targets"],
        pixels=_pixels(content, objects, inputs),
        arithmetic=arithmetic and {**arithmetic, "table": _arithmetic(arithmetic)},
    )


def names_of(content: Mapping[str, Any], figure: str) -> list[str]:
    """Methods that have a figure, in order."""
    found = [row["name"] for row in content["rows"] if figure in next(iter(_any(row).values()))["mean"]]
    return list(dict.fromkeys(found))


def _any(row: Mapping[str, Any]) -> Mapping[str, Any]:
    return next(iter(row["objects"].values()))


def values_of(content: Mapping[str, Any], name: str, objects: str, inputs: str, figure: str) -> list[float]:
    """A figure of a method, one for each seed."""
    return [row["objects"][objects][inputs]["mean"][figure] for row in content["rows"] if row["name"] == name]


def _cell(values: list[float], form: str) -> str:
    mean = form.format(np.mean(values))
    return mean if len(values) < 2 else f"{mean} ± {form.format(np.std(values, ddof=1))}"


def _figures(content: Mapping[str, Any], objects: str, inputs: list[str]) -> str:
    rows = []
    for figure, (title, form) in FIGURES.items():
        for name in names_of(content, figure):
            rows.append(
                [f"{title}: {name}", *(_cell(values_of(content, name, objects, one, figure), form) for one in inputs)]
            )
    return table(["views given", *inputs], rows, "---:")


def _retrieval(content: Mapping[str, Any], objects: str, inputs: list[str]) -> str:
    rows = []
    for name in names_of(content, RETRIEVAL):
        shares = [[100 * one for one in values_of(content, name, objects, count, RETRIEVAL)] for count in inputs]
        rows.append([name, *(_cell(one, "{:.0f}") for one in shares)])
    return table(["views given", *inputs], rows, "---:")


def _pixels(content: Mapping[str, Any], objects: list[str], inputs: list[str]) -> str | None:
    """Pixels found again by C-N3D's features, and how often chance would, or who knows a pixel's place in its picture
    and nothing else: the same place is asked for in all pictures.
    """
    if not (names := names_of(content, "pixel_r1")):
        return None
    rows = []
    for count in objects:
        for title, figure in (("found", "pixel_r1"), ("by chance", "chance")):
            shares = [[100 * one for one in values_of(content, names[0], count, number, figure)] for number in inputs]
            rows.append([f"{count} objects, {title}", *(_cell(one, "{:.2f}") for one in shares)])
    by_place = f"{100 / content['settings']['targets']:.2f}"
    rows.append(["by the place in the picture alone", *(by_place for _ in inputs)])
    return table(["views given", *inputs], rows, "---:")


def _arithmetic(content: Mapping[str, Any]) -> str:
    """What methods make of A - B + C, by the number of views given of each of these."""
    inputs, rows = [str(one) for one in content["settings"]["inputs"]], []
    for figure, (title, form) in OF_ARITHMETIC.items():
        for name in dict.fromkeys(row["name"] for row in content["rows"]):
            runs = [row["inputs"] for row in content["rows"] if row["name"] == name]
            rows.append(
                [f"{title}: {name}", *(_cell([run[one]["mean"][figure] for run in runs], form) for one in inputs)]
            )
    return table(["views given of each", *inputs], rows, "---:")


def _leads(content: Mapping[str, Any], objects: str, inputs: list[str]) -> str:
    """How much less the first 3-D memory errs than the others, with intervals over scenes."""
    first, *others = [name for name in ("GRNN", "2-D tower", "depth reprojection") if name in names_of(content, "l1")]
    rows = []
    for other in others:
        cells = []
        for count in inputs:
            ours, theirs = (_per_scene(content, name, objects, count) for name in (first, other))
            found = paired_record(ours, theirs, range(len(ours)))
            text = "-" if found is None else f"{found['mean']:+.3f}"
            if found is not None and found["low"] is not None:
                text += f" [{found['low']:+.3f}, {found['high']:+.3f}]"
                text = f"**{text}**" if significant_sign(found) else text
            cells.append(text)
        rows.append([f"{first} less {other}", *cells])
    return table(["L1, views given", *inputs], rows, "---:")


def _per_scene(content: Mapping[str, Any], name: str, objects: str, inputs: str) -> list[float]:
    """Mean L1 of each scene over seeds."""
    runs = [row["objects"][objects][inputs]["scenes"] for row in content["rows"] if row["name"] == name]
    return [float(np.mean([scene["l1"] for scene in of_seeds])) for of_seeds in zip(*runs, strict=True)]
