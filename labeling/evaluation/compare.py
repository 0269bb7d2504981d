"""Compares detector and pseudo-labels with ground truth, on the same views."""

import platform
import tomllib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from hotcoco import mask as coco_mask

from labeling.evaluation.records import EpisodeRecords, note_missing, read_records, without_unknown_categories
from labeling.io.label_set import LabelSet, View, calibration_note, pose_warnings, read_label_set
from labeling.metrics.average_precision import mean_of
from labeling.metrics.mask_ap import COCO_IOU_THRESHOLDS, average_precision
from labeling.metrics.matching import Kind, MaskInstance, Match, match, mean_iou
from labeling.runtime.provenance import package_versions

SCHEMA_VERSION = 1
FIGURES = {
    "mask_ap50": "mask AP50",
    "mask_ap30": "mask AP30",
    "box_ap50": "box AP50",
    "box_ap30": "box AP30",
    "mean_iou": "mean IoU",
}
"""The figures of the table, in its order, and their titles."""
LIBRARIES = ("seeing-by-moving", "hotcoco", "numpy")
"""What the figures depend on, beside Python."""

PROTOCOL = tomllib.loads(Path(__file__).with_name("protocol.toml").read_text())
"""How the figures come about; written beside them."""


@dataclass(frozen=True)
class Case:
    """One ground-truth instance in one view and how well it was found."""

    view: View
    category: str
    instance_id: int
    area_px: int
    detector_iou: float
    pseudo_label_iou: float


@dataclass(frozen=True)
class Evaluation:
    """Everything the table, ``metrics.json`` and the report are made from."""

    metrics: dict[str, Any]
    """Content of ``metrics.json``."""
    episodes: tuple[EpisodeRecords, ...]
    labels: LabelSet
    cases: tuple[Case, ...]
    """All counted ground-truth instances, the worst pseudo-label first."""


def evaluate_label_set(
    folder: Path, dataset: Path | None = None, progress: Callable[[Iterable[Path]], Iterable[Path]] = iter
) -> Evaluation:
    """Evaluates a label set, and the detector it stems from, against the ground truth of its dataset.

    Args:
        folder: the label set.
        dataset: where the episodes lie; by default where the label set says.
        progress: wraps the sequence of episodes, to draw a progress bar.

    Raises:
        SbmError: if the label set is malformed, or there is no dataset or no ground truth to compare with.
    """
    labels = read_label_set(folder)
    dataset = labels.find_dataset(dataset)
    notes: list[str] = []
    episodes = without_unknown_categories(tuple(read_records(dataset, labels, progress, notes)), labels, notes)
    note_missing(episodes, labels, notes)
    notes += pose_warnings(labels.provenance)
    unmeasured = calibration_note(labels.provenance)
    notes += [unmeasured] if unmeasured else []
    kept = {view for episode in episodes for view in episode.views}
    truths = [item for episode in episodes for item in episode.truths]
    instance_ids = [number for episode in episodes for number in episode.instance_ids]
    detections = [item for episode in episodes for item in episode.detections]
    pseudo_labels = [item for item in labels.modal if item.image in kept]
    detector_matches, label_matches = match(detections, truths), match(pseudo_labels, truths)
    areas = coco_mask.area([item.rle for item in truths]) if truths else []
    cases = [
        Case(item.image, item.category, number, int(area), detector.iou, label.iou)
        for item, number, area, detector, label in zip(
            truths, instance_ids, areas, detector_matches, label_matches, strict=True
        )
        if not item.ignore
    ]
    looked = any(episode.has_detections for episode in episodes)
    metrics = {
        "schema_version": SCHEMA_VERSION,
        "detector": figures(detections, truths, detector_matches) if looked else _undefined(truths),
        "pseudo_labels": {**figures(pseudo_labels, truths, label_matches), **_amodal_figures(episodes, labels)},
        "counts": {
            "episodes": len(episodes),
            "views": len(kept),
            "ground_truth_instances": len(cases),
            "ignored_instances": len(truths) - len(cases),
            "detections": len(detections),
            "pseudo_labels": len(pseudo_labels),
        },
        "views": _view_figures(episodes, cases),
        "protocol": PROTOCOL,
        "notes": notes,
        "dataset": str(dataset),
        "versions": {"python": platform.python_version(), **package_versions(LIBRARIES)},
        "label_set": {key: value for key, value in labels.provenance.items() if key != "episodes"},
    }
    # The worst pseudo-label first; of equally bad ones the larger object first.
    cases.sort(key=lambda case: (case.pseudo_label_iou, -case.area_px, case.view, case.instance_id))
    return Evaluation(metrics, episodes, labels, tuple(cases))


def figures(
    predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance], matches: Sequence[Match]
) -> dict[str, Any]:
    """All figures of one method, over all categories and per category; None where undefined."""
    ap = _ap_figures(predictions, truths)
    overall = mean_iou(truths, matches)
    category = np.array([item.category for item in truths], dtype=object)
    per_class = {}
    for name in sorted({item.category for item in [*predictions, *truths]}):
        iou = mean_iou(truths, matches, category == name)
        per_class[name] = {
            **{key: per_name[name] for key, (_, per_name) in ap.items()},
            "mean_iou": iou.mean_iou,
            "mean_iou_matched": iou.mean_iou_matched,
            "ground_truth_instances": iou.num_truths,
            "predictions": sum(item.category == name for item in predictions),
        }
    return {
        **{key: mean for key, (mean, _) in ap.items()},
        "mean_iou": overall.mean_iou,
        "mean_iou_matched": overall.mean_iou_matched,
        "ground_truth_instances": overall.num_truths,
        "matched_instances": overall.num_matched,
        "predictions": len(predictions),
        "per_class": per_class,
    }


def _ap_figures(
    predictions: Sequence[MaskInstance], truths: Sequence[MaskInstance]
) -> dict[str, tuple[float | None, dict[str, float | None]]]:
    """Figure name -> (mean, per category)."""
    found: dict[str, tuple[float | None, dict[str, float | None]]] = {}
    kinds: tuple[Kind, ...] = ("mask", "box")
    for kind in kinds:
        result = average_precision(predictions, truths, (0.3, *COCO_IOU_THRESHOLDS), kind)
        every_point = average_precision(predictions, truths, (0.5, 0.3), kind, "all-point")
        for name, source, threshold in (
            (f"{kind}_ap50", result, 0.5),
            (f"{kind}_ap30", result, 0.3),
            (f"{kind}_ap50_all_point", every_point, 0.5),
            (f"{kind}_ap30_all_point", every_point, 0.3),
        ):
            found[name] = (source.mean[threshold], {c: ap[threshold] for c, ap in source.per_class.items()})
        over = {c: mean_of([ap[threshold] for threshold in COCO_IOU_THRESHOLDS]) for c, ap in result.per_class.items()}
        found[f"{kind}_ap"] = (mean_of(list(over.values())), over)
    return found


def _undefined(truths: Sequence[MaskInstance]) -> dict[str, Any]:
    """The figures of a detector that never looked: every one undefined, where an unlucky detector has zeros."""
    blank = figures([], truths, match([], truths))
    counts = ("ground_truth_instances", "predictions", "matched_instances")

    def emptied(record: dict[str, Any]) -> dict[str, Any]:
        return {key: value if key in counts else None for key, value in record.items() if key != "per_class"}

    return {**emptied(blank), "per_class": {name: emptied(record) for name, record in blank["per_class"].items()}}


def _amodal_figures(episodes: Sequence[EpisodeRecords], labels: LabelSet) -> dict[str, Any]:
    """Figures of the whole-object masks; None if no ground truth knows them."""
    views = {view for episode in episodes for view in episode.amodal_views}
    truths = [item for episode in episodes for item in episode.amodal_truths if item.image in views]
    if not truths:
        return {"amodal_mask_ap50": None, "amodal_mask_ap30": None, "amodal_mean_iou": None}
    predictions = [item for item in labels.amodal if item.image in views]
    ap = average_precision(predictions, truths).mean
    return {
        "amodal_mask_ap50": ap[0.5],
        "amodal_mask_ap30": ap[0.3],
        "amodal_mean_iou": mean_iou(truths, match(predictions, truths)).mean_iou,
    }


def _view_figures(episodes: Sequence[EpisodeRecords], cases: Sequence[Case]) -> list[dict[str, Any]]:
    """For every view evaluated how many instances there are and how well they were found."""
    found: dict[View, list[Case]] = {view: [] for episode in episodes for view in episode.views}
    for case in cases:
        found[case.view].append(case)
    return [
        {
            "episode": episode,
            "view": view,
            "ground_truth_instances": len(there),
            "detector_mean_iou": mean_of([case.detector_iou for case in there]),
            "pseudo_label_mean_iou": mean_of([case.pseudo_label_iou for case in there]),
        }
        for (episode, view), there in found.items()
    ]


def categories_by_presence(metrics: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Names of the categories that tables show, and of those of which the views hold no instance, each sorted.

    Args:
        metrics: ``Evaluation.metrics``.
    """
    found = [metrics[source]["per_class"] for source in ("detector", "pseudo_labels") if source in metrics]
    names = sorted({name for per_class in found for name in per_class})
    there = {name for per_class in found for name, record in per_class.items() if record["ground_truth_instances"]}
    return [name for name in names if name in there], [name for name in names if name not in there]
