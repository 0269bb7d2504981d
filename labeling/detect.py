"""Runs a detector on recorded episodes: ``python -m labeling.detect EPISODES --detector NAME_OR_RUN``."""

import hashlib
import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labeling.core.errors import UsageError
from labeling.detectors.command import DetectionCommand, check_writable
from labeling.detectors.registry import DEFAULT
from labeling.io.file_names import ABOUT_FILE, DETECTIONS_FILE, TRUTH_FILE, WRITTEN_BY_DETECTORS
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import make_main, progress_bar, say_next
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    from collections.abc import Callable

    from labeling.core.detector import Detector
    from labeling.core.episode import Episode
    from labeling.core.types import Detection


@dataclass(frozen=True)
class DetectCommand(DetectionCommand):
    """Writes ``detections.json`` (COCO results with RLE masks and scores) beside the frames of each episode.

    Episodes that already hold the results of this detector are skipped, unless their recordings have changed since.
    """

    detector: str = DEFAULT
    """``compact``, ``maskrcnn_resnet50_fpn``, the folder of a labeling.finetune run, ``onnx:FILE`` or
    ``package.module:function``."""
    replace: bool = False
    """Replace detections that this command did not write."""
    batch_size: int = 8
    """Pictures at a time."""


def run(command: DetectCommand) -> None:
    """Detects in all episodes.

    Raises:
        SbmError: if there is no such detector or no episode; and, after all the others are done, if any episode failed.
    """
    from labeling.detectors.registry import NAMES, detector_digest
    from labeling.runtime.process_pool import PerProcess

    command.recording.check()
    digest = detector_digest(command.detector)

    def summary(counts: list[tuple[int, int]]) -> str:
        views, detections = (sum(column) for column in zip((0, 0), *counts, strict=True))
        return f"{detections} detections in {views} views of {len(counts)} episodes"

    command.run_on_episodes(
        _detecting(command) if command.where.is_local else PerProcess(partial(_detecting, command)),
        summary,
        [] if command.detector in NAMES else [command.detector],
        DETECTIONS_FILE,
        lambda folder: _has_looked(folder, command.detector, _mark(folder, digest, command.recording)),
    )
    say_next("label them", "labeling.generate", command.dataset, *command.recording.words(), "--out", "LABELS")


def _detecting(command: DetectCommand) -> "Callable[[Path], tuple[int, int] | None]":
    """What detects in one episode."""
    from labeling.core.masks import MASK_THRESHOLD
    from labeling.detectors.registry import load_detector

    detector = load_detector(command.detector, command.device, command.batch_size, MASK_THRESHOLD)
    return partial(detect_episode, detector=detector, recording=command.recording, replace=command.replace)


def detect_episode(
    folder: Path, detector: "Detector", recording: RecordingConfig | None = None, replace: bool = False
) -> tuple[int, int] | None:
    """Writes ``detections.json`` of one episode, and into ``episode.json`` who found them.

    Args:
        folder: of the episode.
        detector: any.
        recording: how to read it.
        replace: overwrite detections that were not written here.

    Returns:
        Numbers of views and of detections; None if this detector had looked already.

    Raises:
        SbmError: if the episode is malformed, the detector fails, or there are other detections.
    """
    from labeling.core.detector import run_detector
    from labeling.formats.atomic import atomic_file, write_json
    from labeling.formats.checked_json import read_json
    from labeling.io.episodes import detection_record, read_episode

    recording = recording or RecordingConfig()
    path, about_path = folder / DETECTIONS_FILE, folder / ABOUT_FILE
    about: dict[str, Any] = dict(read_json(about_path).mapping()) if about_path.is_file() else {}
    mark = _mark(folder, detector.digest, recording)
    if _has_looked(folder, detector.name, mark):
        return None
    if path.is_file() and not _kept_run(folder, "replaced_sha256") and not _kept_run(folder) and not replace:
        raise UsageError(f"{path}: holds detections that this command did not write; --replace overwrites them")
    check_writable(folder)
    episode = read_episode(folder, recording, detections=False)
    with progress_bar(total=episode.num_views, unit="view", desc=episode.name) as views:
        found = run_detector(detector, episode, views.update)
    ids, categories = _category_ids(folder, about, found, detector)
    image_ids = _image_ids(folder, episode)
    records = [
        {**detection_record(one, ids), "image_id": image_ids[one.view_index], "score": round(one.confidence, 6)}
        for one in found
    ]
    # Of what is written below. Were the process killed between the two files, it would not fit, and the detector would
    # run again, in place of what it was to replace.
    text = json.dumps(records, indent=1, allow_nan=False) + "\n"
    run_record: dict[str, Any] = {"detector": detector.name, "mark": mark, "detections_sha256": _digest(text)}
    if path.is_file():
        run_record["replaced_sha256"] = _digest(path.read_bytes())
    run_record["views"] = episode.num_views
    about |= {"categories": categories, "detector": detector.name, "detector_run": run_record}
    if detector.categories is not None:
        about["detector_categories"] = list(detector.categories)
    else:
        about.pop("detector_categories", None)
    with atomic_file(path) as temporary:  # first, where the disk may be full
        temporary.write_text(text, encoding="utf-8")
        write_json(about_path, about)
    if run_record.pop("replaced_sha256", None):  # whoever puts back what was replaced wants it kept
        write_json(about_path, about)
    return episode.num_views, len(records)


def _mark(folder: Path, digest: str, recording: RecordingConfig) -> str:
    """Changes with a recording, with a detector, and with how it is shown the views."""
    from labeling.io.folder_digest import folder_digest

    return _digest(f"{digest}\0{sorted(asdict(recording).items())}\0{folder_digest(folder, WRITTEN_BY_DETECTORS)}")


def _has_looked(folder: Path, name: str, mark: str) -> bool:
    """Whether an episode has the results of this detector."""
    kept = _kept_run(folder)
    return (kept.get("detector"), kept.get("mark")) == (name, mark)


def _kept_run(folder: Path, digest: str = "detections_sha256") -> dict[str, Any]:
    """What the episode says of the run of this command that its detections come from; empty if they do not.

    Args:
        folder: of the episode.
        digest: what it calls that of the detections; "replaced_sha256" for those that a run was about to replace.
    """
    from labeling.formats.checked_json import read_json

    path, about_path = folder / DETECTIONS_FILE, folder / ABOUT_FILE
    kept = read_json(about_path).mapping().get("detector_run") if about_path.is_file() else None
    ours = isinstance(kept, dict) and path.is_file() and kept.get(digest) == _digest(path.read_bytes())
    return dict(kept) if isinstance(kept, dict) and ours else {}


def _digest(content: str | bytes) -> str:
    return hashlib.sha256(content.encode() if isinstance(content, str) else content).hexdigest()


def _image_ids(folder: Path, episode: "Episode") -> dict[int, int]:
    """Image id of each view: that of ``ground_truth.json``, or the position of its frame in the recording."""
    from labeling.formats.checked_json import read_json
    from labeling.io.coco import view_of_image

    truth = read_json(folder / TRUTH_FILE) if (folder / TRUTH_FILE).is_file() else None
    ids = {view: number for number, view in view_of_image(truth, episode).items() if view is not None}
    missing = [name for view, name in enumerate(episode.file_names) if view not in ids]
    if missing:
        raise UsageError(f"{folder / TRUTH_FILE}: images: does not list {missing[0]}, so its detections have no id")
    return ids


def _category_ids(
    folder: Path, about: dict[str, Any], found: "tuple[Detection, ...]", detector: "Detector"
) -> tuple[dict[str, int], list[dict[str, Any]]]:
    """Ids of the categories, and the list for ``episode.json``: what the episode has names for keeps its id."""
    from labeling.formats.checked_json import read_json
    from labeling.io.coco import CategoryTable
    from labeling.io.episodes import NAMING_FILES

    files = [read_json(folder / name) for name in NAMING_FILES if (folder / name).is_file()]
    known = CategoryTable.from_files(files).name_of_id
    ids: dict[str, int] = {}
    for number, name in known.items():
        ids.setdefault(name, number)
    for name in dict.fromkeys([*(detector.categories or ()), *(one.category for one in found)]):
        ids.setdefault(name, max([0, *known, *ids.values()]) + 1)
    listed = about.get("categories", [])
    there = {entry.get("id") for entry in listed}
    return ids, [*listed, *({"id": number, "name": name} for name, number in ids.items() if number not in there)]


HELP = CommandHelp(
    examples=(
        ("EPISODES", "what compact finds, beside the frames"),
        ("EPISODES --detector RUN --replace", "a fine-tuned detector instead"),
    ),
)
main = make_main("labeling.detect", DetectCommand, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
