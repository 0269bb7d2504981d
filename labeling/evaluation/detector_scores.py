"""Scores the detections of any detector on episodes, or other annotated pictures, that have ground truth."""

import functools
from pathlib import Path
from typing import Any

from labeling.core.detector import Detector
from labeling.core.errors import UsageError
from labeling.detectors.data.annotated_pictures import read_pictures
from labeling.detectors.scoring import detect_all
from labeling.evaluation.compare import PROTOCOL, SCHEMA_VERSION, figures
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.metrics.matching import MaskInstance, instances_of, match
from labeling.runtime.cli import progress_bar


def score_detector(path: Path, detector: Detector) -> dict[str, Any]:
    """Runs a detector and compares what it finds with ground truth.

    Args:
        path: episodes with ground truth, a COCO folder, or a label set to be taken as true.
        detector: any.

    Returns:
        ``counts``, ``notes``, and under ``detector`` the figures of ``labeling.evaluation.compare``.
    """
    pictures = read_pictures(path, "val")
    truths, found = detect_all(detector, pictures, functools.partial(progress_bar, desc="evaluating"))
    stated = {one.category for picture in pictures for one in picture.annotations}
    known = stated if detector.categories is None else stated & set(detector.categories)
    return _metrics(truths, found, len(pictures), sorted(stated - known), path, detector.name)


def score_episodes(path: Path, recording: RecordingConfig | None = None) -> dict[str, Any]:
    """Compares the detections that lie beside the frames of episodes with ground truth.

    Args:
        path: an episode, or a folder of episodes.
        recording: how to read them.

    Raises:
        SbmError: if no episode has both.
    """
    truths: list[MaskInstance] = []
    found: list[MaskInstance] = []
    known: set[str] | None = set()
    names: set[Any] = set()
    views = 0
    for folder in progress_bar(find_episodes(path, recording), "episode", desc="evaluating"):
        episode = read_episode(folder, recording)
        if episode.ground_truth is None:
            raise UsageError(f"{folder}: has no ground_truth.json to compare with")
        if episode.detections is None:
            raise UsageError(
                f"{folder}: has no detections.json; give --detector NAME to look now, or run labeling.detect first"
            )
        views += episode.num_views
        names.add(episode.metadata.get("detector"))
        stated = episode.metadata.get("detector_categories")
        known = None if known is None or not isinstance(stated, list) else known | set(stated)
        truths += instances_of(episode.name, episode.ground_truth)
        found += instances_of(episode.name, episode.detections)
    stated_truths = {truth.category for truth in truths}
    shared = stated_truths if known is None else stated_truths & (known | {one.category for one in found})
    name = ", ".join(sorted(str(one) for one in names if one)) or "unknown"
    return _metrics(
        [one for one in truths if one.category in shared],
        [one for one in found if one.category in shared],
        views,
        sorted(stated_truths - shared),
        path,
        name,
    )


def _metrics(
    truths: list[MaskInstance], found: list[MaskInstance], pictures: int, unknown: list[str], path: Path, name: str
) -> dict[str, Any]:
    if not any(not one.ignore for one in truths):
        raise UsageError(f"{path}: holds no object of a category that {name} has a name for")
    notes = [f"left out, categories that the detector has no name for: {', '.join(unknown)}"] if unknown else []
    return {
        "schema_version": SCHEMA_VERSION,
        "name": name,
        "dataset": str(path),
        "detector": figures(found, truths, match(found, truths)),
        "counts": {
            "views": pictures,
            "ground_truth_instances": sum(not one.ignore for one in truths),
            "ignored_instances": sum(one.ignore for one in truths),
            "detections": len(found),
        },
        "protocol": {key: PROTOCOL[key] for key in ("average_precision", "mean_iou", "boxes")},
        "notes": notes,
    }
