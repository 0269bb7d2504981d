"""The report of an evaluation: one HTML file that needs nothing but a browser."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from labeling.core.errors import SbmError
from labeling.evaluation.compare import FIGURES, Evaluation, categories_by_presence
from labeling.evaluation.report.by_confidence import BACKGROUND, ByConfidence
from labeling.evaluation.report.charts import histogram, line_chart, reliability_chart
from labeling.evaluation.report.errors import KINDS, RIGHT_IOU
from labeling.evaluation.report.pictures import template
from labeling.evaluation.report.scenes import MAX_SCENES, pack_scenes
from labeling.evaluation.report.statistics import SURE, Statistics, statistics_of
from labeling.evaluation.report.view_panels import draw_views
from labeling.formats.atomic import atomic_file
from labeling.inspection.scene import read_scenes

MAX_EPISODE_ROWS = 300
MAX_PROVENANCE_LETTERS = 20_000
MAX_PHANTOM_ROWS = 10
DEFAULT_CONFIDENCE = 0.2
"""Where the slider stands when the page is opened; without scripts all predictions are shown."""
METHODS = {"detector": "Detector", "labels": "Pseudo-labels"}
"""Style of a method on the page -> its name."""


def write_report(path: Path, evaluation: Evaluation, max_views: int = 40, max_worst: int = 12) -> None:
    """Writes the report, atomically.

    Args:
        path: the HTML file.
        evaluation: what to report.
        max_views: views shown at most.
        max_worst: of those, how many for the worst cases, for the most improved, and for phantoms, each.
    """
    metrics = evaluation.metrics
    found = {name: one for name, one in statistics_of(evaluation).items() if one is not None}
    scenes, no_scene = _scenes(evaluation.labels.folder)
    scene_names = [scene["name"] for scene in json.loads(scenes)]
    script = template("report.js").render() + (template("scene.js").render() if scene_names else "")
    page = template("report.html.jinja").render(
        name=Path(metrics["dataset"]).resolve().name,
        metrics=metrics,
        figures=FIGURES,
        categories=categories_by_presence(metrics)[0],
        all_categories=sorted({*metrics["detector"]["per_class"], *metrics["pseudo_labels"]["per_class"]}),
        script=script,
        script_digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii"),
        default_confidence=DEFAULT_CONFIDENCE,
        methods=METHODS,
        statistics=found,
        numbers=json.dumps({name: _numbers(one.by_confidence) for name, one in found.items()}, separators=(",", ":")),
        scenes=scenes,
        scene_names=scene_names,
        no_scene=no_scene,
        charts=_charts(found),
        kinds=KINDS,
        background=BACKGROUND,
        sure=SURE,
        right_iou=RIGHT_IOU,
        confusions=_confusions(found),
        max_phantom_rows=MAX_PHANTOM_ROWS,
        **draw_views(evaluation, max_views, max_worst, found["labels"].phantoms),
        episodes=_episode_rows(metrics["views"], [episode.name for episode in evaluation.episodes]),
        max_episode_rows=MAX_EPISODE_ROWS,
        provenance=_provenance(metrics),
        plural=plural,
    )
    with atomic_file(path) as temporary:
        # JSON can hold halves of characters that are no Unicode; they are shown as their codes.
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")


def plural(count: int, noun: str) -> str:
    """A count and its noun, such as "1 view" and "2 views"."""
    return f"{count:,} {noun}" + ("" if count == 1 else "s")


def _charts(found: Mapping[str, Statistics]) -> dict[str, Any]:
    """By title the charts of the page."""
    curves = [
        (method, category, values) for method, one in found.items() for category, values in one.curves.items() if values
    ]
    return {
        f"Precision and recall, IoU {RIGHT_IOU:g}": line_chart(curves, "recall", "precision"),
        "How well instances are found": histogram(
            {method: one.iou_counts for method, one in found.items()},
            "IoU with ground truth",
            "instances",
            least=max(_highest_bar(one.by_confidence) for one in found.values()),
        ),
        "What a confidence is worth": reliability_chart(
            {method: one.reliability for method, one in found.items()}, "confidence", "mean IoU"
        ),
    }


def _highest_bar(at: ByConfidence) -> int:
    """Of the histogram of IoU, at whichever confidence."""
    parts: dict[int, Any] = {}
    for (_, part), count in at.ious.items():
        parts[part] = parts.get(part, 0) + count
    return max((int(count.max()) for count in parts.values()), default=0)


def _confusions(found: Mapping[str, Statistics]) -> dict[str, dict[str, Any]]:
    """By method the confusion matrix as rows and columns: categories by name, background last."""
    tables = {}
    for method, one in found.items():
        rows = sorted({true for true, _ in one.by_confidence.confusion} - {BACKGROUND})
        columns = sorted({called for _, called in one.by_confidence.confusion} - {BACKGROUND})
        tables[method] = {"rows": [*rows, BACKGROUND], "columns": [*columns, BACKGROUND], "counts": one.confusion}
    return tables


def _numbers(at: ByConfidence) -> dict[str, list[list[Any]]]:
    """Counts as rows, names first and last the changes: confidence in hundredths, count from there on, and so on."""
    return {
        "kinds": [[*names, _changes(count)] for names, count in at.kinds.items()],
        "ious": [[*names, _changes(count)] for names, count in at.ious.items()],
        "iou_sum": [[name, _changes(sums.round(3))] for name, sums in at.iou_sum.items()],
        "confusion": [[*names, _changes(count)] for names, count in at.confusion.items()],
    }


def _changes(values: np.ndarray) -> list[float]:
    steps = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist()]
    return [number for step in steps for number in (step, values[step].item())]


def _scenes(folder: Path) -> tuple[str, str]:
    """What the 3-D tab shows, as JSON, and why it shows nothing if that is so."""
    try:
        packed = pack_scenes(read_scenes(folder, MAX_SCENES))
        return json.dumps(packed, separators=(",", ":"), allow_nan=False), "No episode has a segmented cloud."
    except SbmError as error:
        return "[]", str(error)
    except ValueError:  # JSON that a browser reads has neither NaN nor infinity
        return "[]", f"{folder}: its boxes are too large to be drawn."


def _episode_rows(view_figures: Sequence[dict[str, Any]], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """By episode: its views, its instances, and their mean IoU by detector and pseudo-labels, None without any."""
    found = {}
    for name in names:
        records = [record for record in view_figures if record["episode"] == name]
        count = sum(record["ground_truth_instances"] for record in records)
        found[name] = {"name": name, "views": len(records), "instances": count}
        for method in ("detector", "pseudo_label"):
            total = sum((record[f"{method}_mean_iou"] or 0.0) * record["ground_truth_instances"] for record in records)
            found[name][method] = total / count if count else None
    return found


def _provenance(metrics: dict[str, Any]) -> str:
    """Which settings and versions made the labels and the figures."""
    content = {"dataset": metrics["dataset"], "evaluated_with": metrics["versions"], "label_set": metrics["label_set"]}
    text = json.dumps(content, indent=2, ensure_ascii=False)
    if len(text) > MAX_PROVENANCE_LETTERS:
        text = text[:MAX_PROVENANCE_LETTERS] + "\n… (the rest is in metrics.json)"
    return text
