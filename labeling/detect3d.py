"""Finds 3-D boxes in recorded episodes: ``python -m labeling.detect3d EPISODES --detector RUN --boxes DETECTOR``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.core.errors import EpisodeFormatError, SbmError, UsageError
from labeling.io.file_names import DETECTIONS_3D_FILE, DETECTIONS_FILE
from labeling.io.formats.atomic import write_json
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import run_command

if TYPE_CHECKING:
    from labeling.core.detector import Detector
    from labeling.core.episode import Episode
    from labeling.core.types import Detection
    from labeling.detectors3d.base import Detection3d, Detector3d

RECORDED = "recorded"


@dataclass(frozen=True)
class Detect3dConfig:
    """Writes ``detections_3d.json`` beside the frames of each episode: boxes in the world, each found from one view.

    Episodes that these detectors have already looked at are passed over.
    """

    dataset: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="EPISODES")]]
    """An episode, or a folder of episodes."""
    detector: str
    """The folder of a labeling.train3d run, or ``ldls``, which needs no training."""
    boxes: str = RECORDED
    """Who finds objects in pictures: a 2-D detector as for labeling.detect, or ``recorded`` for the detections.json
    that episodes have."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)


def run(config: Detect3dConfig) -> None:
    """Detects in all episodes.

    Raises:
        SbmError: if there is no such detector or no episode; and, after all the others are done, if any episode failed.
    """
    from tqdm import tqdm

    from labeling.detectors.registry import load_detector
    from labeling.detectors3d.registry import load_detector_3d
    from labeling.io.episodes import find_episodes

    config.recording.check()
    lifter = load_detector_3d(config.detector, config.device)
    finder = None if config.boxes == RECORDED else load_detector(config.boxes, config.device)
    folders = find_episodes(config.dataset, config.recording)
    found, failed, passed_over = 0, 0, 0
    for folder in tqdm(folders, desc="detecting", unit="episode", delay=2.0, leave=False, file=sys.stderr):
        try:
            count = detect_episode(folder, lifter, finder, config.recording)
        except SbmError as error:
            tqdm.write(f"error: {error}", file=sys.stderr)
            failed += 1
            continue
        if count is None:
            passed_over += 1
        else:
            found += count
    done = len(folders) - failed - passed_over
    print(f"{found} boxes in {done} episodes", end="")
    print(f"; {passed_over} were done already" if passed_over else "", end="")
    print(f": {config.dataset / '*' / DETECTIONS_3D_FILE}")
    if failed:
        raise SbmError(f"{failed} of {len(folders)} episodes failed, for the reasons above")


def detect_episode(
    folder: Path, lifter: "Detector3d", finder: "Detector | None", recording: RecordingConfig | None = None
) -> int | None:
    """Writes ``detections_3d.json`` of one episode.

    Args:
        folder: of the episode.
        lifter: of detections to boxes.
        finder: of objects in pictures; None takes the detections that the episode has.
        recording: how to read it.

    Returns:
        How many boxes; None if these detectors have looked already.

    Raises:
        SbmError: if the episode is malformed or has no detections, or a detector fails.
    """
    from labeling.io.episodes import read_episode

    path = folder / DETECTIONS_3D_FILE
    mark = _mark(folder, lifter, finder)
    if path.is_file() and _read(path).get("mark") == mark:
        return None
    episode = read_episode(folder, recording, ground_truth=False)
    boxes = lifter.lift(episode, detections_of(episode, finder))
    content = {
        "detector": lifter.name,
        "boxes": RECORDED if finder is None else finder.name,
        "mark": mark,
        "detections": [_record(episode, one) for one in boxes],
    }
    write_json(path, content)
    return len(boxes)


def detections_of(episode: "Episode", finder: "Detector | None") -> "tuple[Detection, ...]":
    """What a 2-D detector finds, or has found.

    Raises:
        SbmError: if the episode has no detections, or the detector fails.
    """
    from labeling.detectors.run_detector import run_detector

    if finder is not None:
        return run_detector(finder, episode)
    if episode.detections is None:
        raise UsageError(f"{episode.name}: has no detections.json; give a 2-D detector with --boxes")
    return episode.detections


def read_detections_3d(path: Path, num_views: int) -> "list[Detection3d]":
    """Reads what ``detect_episode`` has written.

    Raises:
        EpisodeFormatError: naming file and field, if it is malformed.
    """
    from labeling.detectors3d.base import Detection3d
    from labeling.io.coco import read_valid_box_3d
    from labeling.io.formats.checked_json import read_json

    found = []
    for record in read_json(path).list_of("detections"):
        view, score = record.integer("view"), record.number("score")
        if not 0 <= view < num_views:
            raise record.error(f"there is no view {view}; there are {num_views}", "view")
        if not 0.0 <= score <= 1.0:
            raise record.error(f"a score lies in [0, 1], not {score:g}", "score")
        found.append(Detection3d(view, record.text("category"), score, read_valid_box_3d(record.get("box_3d"))))
    return found


def _record(episode: "Episode", one: "Detection3d") -> dict[str, Any]:
    from labeling.io.episodes import box_3d_record

    return {
        "view": one.view_index,
        "file_name": episode.file_names[one.view_index],
        "category": one.category,
        "score": round(one.confidence, 6),
        "box_3d": box_3d_record(one.box),
    }


def _mark(folder: Path, lifter: "Detector3d", finder: "Detector | None") -> str:
    """Changes with both detectors, and with the detections that are lifted."""
    import hashlib

    recorded = folder / DETECTIONS_FILE
    source = finder.digest if finder is not None else recorded.read_bytes().hex() if recorded.is_file() else ""
    return hashlib.sha256(f"{lifter.digest}\0{source}".encode()).hexdigest()


def _read(path: Path) -> dict[str, Any]:
    from labeling.io.formats.checked_json import read_json

    try:
        return dict(read_json(path).mapping())
    except EpisodeFormatError:
        return {}


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(Detect3dConfig, run, "python -m labeling.detect3d", arguments)


if __name__ == "__main__":
    sys.exit(main())
