"""The page about fine-tuning, of ``fine_tuning.json`` and ``fine_tuning_streets.json``."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.pages.markdown import Pictures, mean_std, points, read_result, render
from experiments.tables.fine_tuning import ALONE, INTERPOLATED, LABELS, TRUE_MASKS, WITHOUT_FALSE
from experiments.tables.training_sets import TRUTH
from labeling.core.errors import SbmError

RESULTS, PAGE, PICTURE = ("fine_tuning.json", "fine_tuning_streets.json"), "fine-tuning.md", "fine_tuning.png"
OF_LABELS = RESULTS
"""Files of results whose figures depend on labels."""
TEACHERS = {
    LABELS: "labels",
    WITHOUT_FALSE: "labels, no false ones",
    TRUE_MASKS: "labels, no false ones, true masks",
    TRUTH: "ground truth",
}
WITHOUT_REPLAY = {
    ALONE[LABELS]: "labels, no photographs",
    ALONE[TRUTH]: "ground truth, no photographs",
    INTERPOLATED[LABELS]: "labels, no photographs, interpolated",
    INTERPOLATED[TRUTH]: "ground truth, no photographs, interpolated",
}
FIGURES = {"mask_ap50": "masks AP50", "box_ap50": "boxes AP50", "mask_ap30": "masks AP30", "box_ap30": "boxes AP30"}
"""In dev scenes."""


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its picture, of the worlds that there are results of.

    Raises:
        SbmError: if there are none, or a file is damaged.
    """
    from experiments.figures.fine_tuning import draw_fine_tuning

    contents = [content for name in RESULTS if (content := read_result(results / name)) is not None]
    if not contents:
        raise SbmError(f"{results / RESULTS[0]} is missing; python -m experiments.run fine_tuning makes it")
    return page(contents), {PICTURE: partial(draw_fine_tuning, contents, TEACHERS | WITHOUT_REPLAY)}


def page(contents: Sequence[Mapping[str, Any]]) -> str:
    """The text of the page."""
    return render(
        "fine-tuning.md.jinja",
        **contents[0],
        worlds=[_world(content) for content in contents],
        figures=list(FIGURES.values()),
        picture=PICTURE,
    )


def gap_closed(
    content: Mapping[str, Any], figure: str = "mask_ap50", names: Mapping[str, str] | None = None
) -> float | None:
    """Share of the way from the detector before to ground-truth fine-tuning that learning from labels goes, by means
    over seeds; None where ground truth does not help.

    Args:
        content: of the file of results.
        figure: which AP.
        names: what the record calls learning from ``LABELS`` and from ``TRUTH``, such as ``ALONE``; by default that.
    """
    before = content["before"]["dev"][figure]
    teachers = [(names or {}).get(one, one) for one in (LABELS, TRUTH)]
    labels, truth = (np.mean([run["dev"][figure] for run in _runs(content, one)]) for one in teachers)
    return float((labels - before) / (truth - before)) if truth > before else None


def _runs(content: Mapping[str, Any], teacher: str) -> list[Mapping[str, Any]]:
    return [run for run in content["runs"] if run["teacher"] == teacher]


def _world(content: Mapping[str, Any]) -> dict[str, Any]:
    before, pools = content["before"], content["pools"].items()
    boxes = {name: ap for name, ap in before["dev"]["per_class_box_ap50"].items() if ap is not None}
    means = [["before", *(points(before["dev"][one]) for one in FIGURES), points(before["photographs"]["mask_ap50"])]]
    per_category = [["before", *(points(boxes[category]) for category in sorted(boxes))]]
    for teacher, words in {**TEACHERS, **WITHOUT_REPLAY}.items():
        runs = _runs(content, teacher)
        cells = [mean_std([100 * run["dev"][one] for run in runs]) for one in FIGURES]
        means.append([words, *cells, mean_std([100 * run["photographs"]["mask_ap50"] for run in runs])])
        of_each = [[100 * run["dev"]["per_class_box_ap50"][name] for run in runs] for name in sorted(boxes)]
        per_category.append([words, *map(mean_std, of_each)])
    gaps = [[gap_closed(content, one, names) for one in FIGURES] for names in (None, ALONE, INTERPOLATED)]
    return {
        "name": content["world"],
        "scale": content["scale"],
        "seeds": content["seeds"],
        "train": content["settings"]["train"],
        "episodes": {part: pool["episodes"] for part, pool in pools},
        "scenes": {part: len(set(pool["scenes"])) for part, pool in pools},
        "means": means,
        "gaps": [["-" if share is None else f"{share:.2f}" for share in shares] for shares in gaps],
        "categories": sorted(boxes),
        "per_category": per_category,
        "false_weight": mean_std([100 * one["false_weight"] for one in content["labels"]]),
        "errors": error_rows([one["categories"] for one in content["labels"]]),
    }


def error_rows(counts: Sequence[Mapping[str, Mapping[str, int]]]) -> list[list[str]]:
    """Labels, false ones, objects, and those without a label, by category: means over seeds, without categories of
    which there is nothing.

    Args:
        counts: by seed and category (``label_errors.count_errors``).
    """
    rows, nothing = [], {"labels": 0, "false": 0, "objects": 0, "missing": 0}
    for name in sorted({name for one in counts for name in one}):
        means = [np.mean([one.get(name, nothing)[kind] for one in counts]) for kind in nothing]
        if any(means):
            rows.append([name, *(f"{one:.0f}" for one in means)])
    return rows
