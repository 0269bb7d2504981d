"""The page about labels made of what other detectors find: the result of ``python -m experiments.detector_labels``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.pages.markdown import Pictures, points, read_result, render, table
from labeling.core.errors import SbmError
from labeling.evaluation.compare import FIGURES

PAGE = "detector-labels.md"
OF_LABELS = ("detector_labels.json",)
"""Files of results whose figures depend on labels."""
WHAT = {"detections": "what it finds", "alone": "labels, each episode alone", "shared": "labels, shared by a scene"}


def compose(results: Path) -> tuple[str, Pictures]:
    """The page; it has no pictures.

    Raises:
        SbmError: if there is no result.
    """
    content = read_result(results / "detector_labels.json")
    if content is None:
        raise SbmError(f"{results}: no detector_labels.json; run python -m experiments.detector_labels")
    return page(content), {}


def page(content: Mapping[str, Any]) -> str:
    """The text of the page."""
    datasets: dict[str, list[Mapping[str, Any]]] = {}
    for record in content["detectors"]:
        datasets.setdefault(record["dataset"], []).append(record)
    return render("detector-labels.md.jinja", datasets=datasets, tables={k: _table(v) for k, v in datasets.items()})


def _table(records: Sequence[Mapping[str, Any]]) -> str:
    rows = [
        [
            f"`{record['detector']}`" if what == "detections" else "",
            title,
            *(points(record[what][one]) for one in FIGURES),
        ]
        for record in records
        for what, title in WHAT.items()
    ]
    return table(["", "", *FIGURES.values()], rows, "---:")
