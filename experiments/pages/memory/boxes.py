"""The page about boxes on memories, of the experiments ``memory_boxes`` and ``label_fraction``."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from experiments.cache.egomotion import METHODS
from experiments.pages.markdown import Pictures, mean_std, read_result, render, table
from labeling.core.errors import SbmError

PAGE, VIEWS_PICTURE, LABELS_PICTURE = "memory-boxes.md", "memory_boxes.png", "label_fraction.png"
OF_LABELS = ("memory_boxes.json",)
"""Files of results whose figures depend on labels."""
FIGURES = {"ap25": "AP .25", "ap50": "AP .5"}
KINDS = ("all", "shown")
TURNS_DEG = (0, 10, 20, 30, 180)
"""Bounds between pairs of views that are told apart by how far the camera has turned."""


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its pictures."""
    from experiments.figures.memory_boxes import draw_by_labels, draw_by_views

    views, labels = (read_result(results / f"{name}.json") for name in ("memory_boxes", "label_fraction"))
    if views is None and labels is None:
        raise SbmError(f"{results}: neither memory_boxes.json nor label_fraction.json; run one of them first")
    pictures: Pictures = {}
    if views is not None:
        pictures[VIEWS_PICTURE] = partial(draw_by_views, views)
    if labels is not None:
        pictures[LABELS_PICTURE] = partial(draw_by_labels, labels)
    return page(views, labels), pictures


def page(views: Mapping[str, Any] | None, labels: Mapping[str, Any] | None) -> str:
    """The text of the page.

    Args:
        views: of ``memory_boxes.json``, if there is one.
        labels: of ``label_fraction.json``, likewise.
    """
    by_views = views and {kind: _by_views(views, kind) for kind in KINDS}
    return render(
        "memory-boxes.md.jinja",
        views=views and {**views, "tables": by_views, "motions": _motions(views)},
        labels=labels and {**labels, "tables": {str(n): _by_labels(labels, n) for n in labels["settings"]["inputs"]}},
        gains=labels and {str(n): _gains(labels, n) for n in labels["settings"]["inputs"]},
        views_picture=VIEWS_PICTURE,
        labels_picture=LABELS_PICTURE,
    )


def percents(rows: Sequence[Mapping[str, Any]], inputs: int, kind: str, figure: str) -> list[float]:
    """A figure of rows in percent, one for each seed; rows of which nothing was to be found have none."""
    values = [row["inputs"][str(inputs)][kind][figure] for row in rows]
    return [100 * value for value in values if value is not None]


def _by_views(content: Mapping[str, Any], kind: str) -> str:
    inputs, rows = content["settings"]["inputs"], []
    for figure, title in FIGURES.items():
        for name, labels in dict.fromkeys((row["name"], row["labels"]) for row in content["rows"]):
            runs = [row for row in content["rows"] if (row["name"], row["labels"]) == (name, labels)]
            cells = [mean_std(percents(runs, count, kind, figure)) for count in inputs]
            rows.append([f"{title}: {name}, {labels}", *cells])
    return table(["views given", *map(str, inputs)], rows, "---:")


def _motions(content: Mapping[str, Any]) -> str:
    """Median errors of the motion between views, by how far the camera has turned."""
    rows = []
    for low, high in pairwise(TURNS_DEG):
        pairs = [pair for pair in content["motion"] if low <= pair["none"]["turn_deg"] < high]
        if pairs:
            cells = [
                f"{median(pair[name]['turn_deg'] for pair in pairs):.1f}°, "
                f"{median(pair[name]['shift_cm'] for pair in pairs):.1f} cm"
                for name in METHODS
            ]
            turn = f"{low} to {high}°" if high < TURNS_DEG[-1] else f"{low}° and more"
            rows.append([turn, str(len(pairs)), *cells])
    return table(["turn", "pairs", "the motion itself", "alignment of volumes", "ICP"], rows, "---:")


def _by_labels(content: Mapping[str, Any], inputs: int) -> str:
    shares, rows = content["settings"]["shares"], []
    for figure, title in FIGURES.items():
        for name, beginning in dict.fromkeys((row["name"], row["beginning"]) for row in content["rows"]):
            runs = [row for row in content["rows"] if (row["name"], row["beginning"]) == (name, beginning)]
            cells = [
                mean_std(percents([row for row in runs if row["share"] == share], inputs, "shown", figure))
                for share in shares
            ]
            rows.append([f"{title}: {name} {beginning}", *cells])
    return table(["scenes labelled", *(f"{100 * share:g} %" for share in shares)], rows, "---:")


def _gains(content: Mapping[str, Any], inputs: int) -> str:
    """What a memory that has learnt before is better by, seed by seed: networks of a seed have the same rooms labelled,
    those with a larger share more beside them.
    """
    shares, rows = content["settings"]["shares"], []
    scratch = content["rows"][0]["beginning"]
    found = {
        (row["name"], row["beginning"], row["share"], row["seed"]): row["inputs"][str(inputs)]["shown"]
        for row in content["rows"]
    }
    after = dict.fromkeys((row["name"], row["beginning"]) for row in content["rows"] if row["beginning"] != scratch)

    def gain(name: str, beginning: str, figure: str, share: float, of_rival: float | None) -> str:
        if of_rival is None:
            return "-"
        pairs = [
            (found[name, beginning, share, seed], found[name, scratch, of_rival, seed]) for seed in content["seeds"]
        ]
        return mean_std([100 * (one[figure] - other[figure]) for one, other in pairs])

    for figure, title in FIGURES.items():
        for name, beginning in after:
            for rivals, which in ((shares, ""), ([*shares[1:], None], " with the next larger share")):
                cells = [gain(name, beginning, figure, *both) for both in zip(shares, rivals, strict=True)]
                rows.append([f"{title}: {name} {beginning} less random weights{which}", *cells])
    return table(["scenes labelled", *(f"{100 * share:g} %" for share in shares)], rows, "---:")
