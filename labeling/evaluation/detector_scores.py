"""Scores the detections of any detector on episodes, or other annotated pictures, that have ground truth."""

import functools
from pathlib import Path
from typing import Any

from labeling.core.detector import Detector, run_detector
from labeling.core.errors import UsageError
from labeling.detectors.data.annotated_pictures import read_pictures
from labeling.detectors.scoring import detect_all
from labeling.evaluation.compare import PROTOCOL, SCHEMA_VERSION, figures
from labeling.evaluation.records import detector_categories
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.metrics.matching import MaskInstance, instances_of, match
from labeling.runtime.cli import progress_bar


def score_detector(path: Path, detector: Detector, dataset: Path | None = None) -> dict[str, Any]:
    """Runs a detector on pictures and compares what it finds with what is annotated.

    Args:
        path: a COCO folder or file, or a label set to be taken as true.
        detector: any; it gets no depth.
        dataset: where the pictures of a label set lie; by default where it says.

    Returns:
        ``counts``, ``notes``, and under ``detector`` the figures of ``labeling.evaluation.compare``.
    """
    pictures = read_pictures(path, "val", dataset)
    truths, found = detect_all(detector, pictures, functools.partial(progress_bar, desc="evaluating"))
    stated = {one.category for picture in pictures for one in picture.annotations}
    known = stated if detector.categories is None else stated & set(detector.categories)
    return _metrics(truths, found, len(pictures), sorted(stated - known), path, detector.name)


def score_episodes(
    path: Path, recording: RecordingConfig | None = None, detector: Detector | None = None
) -> dict[str, Any]:
    """Compares detections in the views of episodes with ground truth.

    Args:
        path: an episode, or a folder of episodes.
        recording: how to read them.
        detector: looks at the views now, with their depth; None takes the detections that lie beside the frames.

    Raises:
        SbmError: if an episode lacks ground truth or detections, or the detector fails.
    """
    truths: list[MaskInstance] = []
    found: list[MaskInstance] = []
    known: set[str] | None = set()
    names: set[str] = set()
    views = 0
    for folder in progress_bar(find_episodes(path, recording), "episode", desc="evaluating"):
        episode = read_episode(folder, recording, detections=detector is None)
        true, detections = episode.ground_truth, episode.detections
        if true is None:
            raise UsageError(f"{folder}: has no ground_truth.json to compare with")
        if detector is not None:
            detections = run_detector(detector, episode)
        if detections is None:
            raise UsageError(
                f"{folder}: has no detections.json; give --detector NAME to look now, or run labeling.detect first"
            )
        views += episode.num_views
        made_by = episode.metadata.get("detector") if detector is None else detector.name
        names.add(made_by if isinstance(made_by, str) else "")
        stated = detector_categories(folder, episode) if detector is None else detector.categories
        known = None if known is None or stated is None else known | set(stated)
        truths += instances_of(episode.name, true)
        found += instances_of(episode.name, detections)
    stated_truths = {truth.category for truth in truths}
    shared = stated_truths if known is None else stated_truths & (known | {one.category for one in found})
    name = ", ".join(sorted(names - {""})) or "unknown"
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
