"""The page about fine-tuning, of ``fine_tuning.json``."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.pages.markdown import Pictures, mean_range, points, read_result, render
from labeling.core.errors import SbmError

RESULTS, PAGE, PICTURE = "fine_tuning.json", "fine-tuning.md", "fine_tuning.png"
TEACHERS = {"labels": "SbM labels", "truth": "ground truth"}
COLUMNS = (("validation", "mask_ap50"), ("validation", "mask_ap30"), ("photographs", "mask_ap50"))
"""Of the table of means: which pictures, and which figure."""


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its picture, from ``fine_tuning.json``."""
    from experiments.figures.fine_tuning import draw_fine_tuning

    content = read_result(results / RESULTS)
    if content is None:
        raise SbmError(f"{results / RESULTS} is missing; python -m experiments.run fine_tuning makes it")
    return page(content), {PICTURE: partial(draw_fine_tuning, content, TEACHERS)}


def page(content: Mapping[str, Any]) -> str:
    """The text of the page."""
    worlds = [_world(name, world) for name, world in content["worlds"].items()]
    return render(
        "fine-tuning.md.jinja", **{**content, "worlds": worlds, "train": content["settings"]["train"]}, picture=PICTURE
    )


def gap_closed(world: Mapping[str, Any], figure: str = "mask_ap50") -> float | None:
    """Share of the way from the detector before to ground-truth fine-tuning that learning from labels goes, by means
    over seeds; None where ground truth does not help.
    """
    before = world["before"]["validation"][figure]
    labels, truth = (np.mean([run["validation"][figure] for run in _runs(world, teacher)]) for teacher in TEACHERS)
    return float((labels - before) / (truth - before)) if truth > before else None


def _runs(world: Mapping[str, Any], teacher: str) -> list[Mapping[str, Any]]:
    return [run for run in world["runs"] if run["teacher"] == teacher]


def _world(name: str, world: Mapping[str, Any]) -> dict[str, Any]:
    before = world["before"]
    ap50 = {category: ap for category, ap in before["validation"]["per_class_ap50"].items() if ap is not None}
    means = [["before", *(points(before[part][figure]) for part, figure in COLUMNS)]]
    per_category = [["before", *(points(ap50[category]) for category in sorted(ap50))]]
    for teacher, words in TEACHERS.items():
        runs = _runs(world, teacher)
        figures = [[100 * run[part][figure] for run in runs] for part, figure in COLUMNS]
        means.append([f"after {words}", *map(mean_range, figures)])
        of_category = {c: np.mean([run["validation"]["per_class_ap50"][c] for run in runs]) for c in sorted(ap50)}
        per_category.append([f"after {words}", *(points(float(ap)) for ap in of_category.values())])
    pools = world["pools"].items()
    return {
        "name": name,
        "episodes": {part: pool["episodes"] for part, pool in pools},
        "scenes": {part: len(set(pool["scenes"])) for part, pool in pools},
        "detector_ap50": points(world["labels"][0]["detector"]["mask_ap50"]),
        "labels_ap50": mean_range([100 * one["pseudo_labels"]["mask_ap50"] for one in world["labels"]]),
        "gap_closed": gap_closed(world),
        "means": means,
        "categories": sorted(ap50),
        "per_category": per_category,
    }
