"""Finds 3-D boxes in recorded episodes: ``python -m labeling.detect3d EPISODES --detector RUN``."""

import hashlib
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.detectors.command import DetectionCommand, check_writable
from labeling.formats.atomic import write_json
from labeling.formats.checked_json import read_json
from labeling.io.file_names import DETECTIONS_3D_FILE, WRITTEN_BY_DETECTORS
from labeling.io.folder_digest import folder_digest
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    from collections.abc import Callable

    from labeling.core.detector import Detector
    from labeling.detectors3d.base import Detector3d
    from labeling.memory.boxes.box_detector import MemoryBoxDetector
    from labeling.memory.flow.flow_detector import MovingDetector

RECORDED, LDLS = "recorded", "ldls"


@dataclass(frozen=True)
class Detect3dCommand(DetectionCommand):
    """Writes ``detections_3d.json`` beside the frames of each episode: boxes in the world, each found from one view, or
    from several views together where the detector has a memory; or of what moves from one view to the next.

    Episodes that already hold the results of these detectors are skipped, unless their recordings have changed since.
    """

    detector: str
    """The folder of a labeling.train3d run (of one with --memory, too) or of a labeling.train_flow run, which finds
    what moves; or ``ldls``, which needs no training."""
    boxes: str = RECORDED
    """Who finds objects in pictures: a 2-D detector as for labeling.detect, or ``recorded`` for the detections.json
    that episodes have. A memory needs neither."""
    views: int | None = None
    """Of a memory: views of each episode that go into it, spread evenly; by default as many as it was trained with."""


def run(command: Detect3dCommand) -> None:
    """Detects in all episodes.

    Raises:
        SbmError: if there is no such detector or no episode; and, after all the others are done, if any episode failed.
    """
    from labeling.detectors.registry import NAMES
    from labeling.runtime.process_pool import PerProcess

    command.recording.check()
    _check_memory(command)
    command.run_on_episodes(
        _detecting(command) if command.where.is_local else PerProcess(partial(_detecting, command)),
        lambda counts: f"{sum(counts)} boxes in {len(counts)} episodes",
        [name for name in (command.detector, command.boxes) if name not in (*NAMES, RECORDED, LDLS)],
        DETECTIONS_3D_FILE,
    )
    single = (command.dataset / DETECTIONS_3D_FILE).is_file()
    print(command.dataset / ("" if single else "*") / DETECTIONS_3D_FILE)


def _has_memory(command: Detect3dCommand) -> bool:
    from labeling.memory.boxes.box_detector import is_memory_run

    return command.detector != LDLS and is_memory_run(Path(command.detector))


def _sees_motion(command: Detect3dCommand) -> bool:
    from labeling.memory.flow.flow_detector import is_flow_run

    return command.detector != LDLS and is_flow_run(Path(command.detector))


def _check_memory(command: Detect3dCommand) -> None:
    """Refuses options that do not belong to the detector.

    Raises:
        UsageError: naming the option.
    """
    if command.views is not None and command.views < 1:
        raise UsageError(f"--views must be above 0, not {command.views}")
    if (_has_memory(command) or _sees_motion(command)) and command.boxes != RECORDED:
        raise UsageError(
            f"{command.detector}: looks at several views together and needs no 2-D detector; leave out --boxes"
        )
    if command.views is not None and not _has_memory(command):
        raise UsageError(f"--views is for detectors with a memory (labeling.train3d --memory), not {command.detector}")


def _detecting(command: Detect3dCommand) -> "Callable[[Path], int | None]":
    """What detects in one episode."""
    if _has_memory(command):
        from labeling.memory.boxes.box_detector import load_memory_detector

        memory = load_memory_detector(Path(command.detector), command.device)
        return partial(detect_with_memory, detector=memory, views=command.views, recording=command.recording)
    if _sees_motion(command):
        from labeling.memory.flow.flow_detector import load_moving_detector

        flow = load_moving_detector(Path(command.detector), command.device)
        return partial(detect_moving, detector=flow, recording=command.recording)
    from labeling.detectors.registry import load_detector
    from labeling.detectors3d.registry import load_detector_3d

    return partial(
        detect_episode,
        detector_3d=load_detector_3d(command.detector, command.device),
        detector_2d=None if command.boxes == RECORDED else load_detector(command.boxes, command.device),
        recording=command.recording,
    )


def detect_episode(
    folder: Path, detector_3d: "Detector3d", detector_2d: "Detector | None", recording: RecordingConfig | None = None
) -> int | None:
    """Writes ``detections_3d.json`` of one episode.

    Args:
        folder: of the episode.
        detector_3d: lifts detections to boxes.
        detector_2d: finds objects in pictures; None takes the detections that the episode has.
        recording: how to read it.

    Returns:
        How many boxes; None if these detectors have looked already.

    Raises:
        SbmError: if the episode is malformed or has no detections, or a detector fails.
    """
    from labeling.core.detector import run_detector
    from labeling.io.episodes import box_3d_record, read_episode

    path = folder / DETECTIONS_3D_FILE
    found_in = folder_digest(folder, [DETECTIONS_3D_FILE] if detector_2d is None else WRITTEN_BY_DETECTORS)
    mark = _mark(recording, detector_3d.digest, RECORDED if detector_2d is None else detector_2d.digest, found_in)
    if _mark_of_file(path) == mark:
        return None
    check_writable(folder)
    episode = read_episode(folder, recording, ground_truth=False)
    detections = episode.detections if detector_2d is None else run_detector(detector_2d, episode)
    if detections is None:
        raise UsageError(f"{episode.name}: has no detections.json; give a 2-D detector with --boxes")
    records = [
        {
            "view": one.view_index,
            "file_name": episode.file_names[one.view_index],
            "category": one.category,
            "score": round(one.confidence, 6),
            "box_3d": box_3d_record(one.box),
        }
        for one in detector_3d.lift(episode, detections)
    ]
    content = {
        "detector": detector_3d.name,
        "boxes": RECORDED if detector_2d is None else detector_2d.name,
        "mark": mark,
        "detections": records,
    }
    write_json(path, content)
    return len(records)


def detect_with_memory(
    folder: Path, detector: "MemoryBoxDetector", views: int | None = None, recording: RecordingConfig | None = None
) -> int | None:
    """Likewise from several views together.

    Args:
        folder: of the episode.
        detector: finds boxes in a memory.
        views: how many views go into it; None takes as many as it was trained with.
        recording: how to read the episode.

    Returns:
        How many boxes; None if this detector has looked already.

    Raises:
        SbmError: if the episode is malformed, or cannot be remembered.
    """
    from labeling.io.episodes import box_3d_record, read_episode

    path = folder / DETECTIONS_3D_FILE
    mark = _mark(recording, detector.digest, str(views), folder_digest(folder, WRITTEN_BY_DETECTORS))
    if _mark_of_file(path) == mark:
        return None
    check_writable(folder)
    found = detector.find(read_episode(folder, recording, ground_truth=False), views)
    records = [
        {
            "views": list(one.views),
            "category": one.category,
            "score": round(one.confidence, 6),
            "box_3d": box_3d_record(one.box),
        }
        for one in found
    ]
    write_json(path, {"detector": detector.name, "mark": mark, "detections": records})
    return len(records)


def detect_moving(folder: Path, detector: "MovingDetector", recording: RecordingConfig | None = None) -> int | None:
    """Likewise what moves from each view to the next.

    Args:
        folder: of the episode.
        detector: tells flow on a memory.
        recording: how to read the episode.

    Returns:
        How many boxes, each where its object is in the first of two views; None if this detector has looked already.

    Raises:
        SbmError: if the episode is malformed, or no two of its views can be compared.
    """
    from labeling.io.episodes import box_3d_record, read_episode
    from labeling.memory.flow.moving_objects import MOVING

    path = folder / DETECTIONS_3D_FILE
    mark = _mark(recording, detector.digest, "moving", folder_digest(folder, WRITTEN_BY_DETECTORS))
    if _mark_of_file(path) == mark:
        return None
    check_writable(folder)
    episode = read_episode(folder, recording, ground_truth=False)
    records = [
        {
            "views": list(pair.view_index),
            "category": MOVING,
            "score": round(one.confidence, 6),
            "box_3d": box_3d_record(one.box),
            "displacement_m": one.displacement_m.tolist(),
        }
        for pair, found in detector.find(episode.name, episode)
        for one in found
    ]
    write_json(path, {"detector": detector.name, "mark": mark, "detections": records})
    return len(records)


def _mark(recording: RecordingConfig | None, *found: str) -> str:
    """Changes with what finds boxes, with what it finds them in, and with how it is shown the views."""
    how = sorted(asdict(recording or RecordingConfig()).items())
    return hashlib.sha256("\0".join([*found, str(how)]).encode()).hexdigest()


def _mark_of_file(path: Path) -> object:
    try:
        return read_json(path).mapping().get("mark") if path.is_file() else None
    except EpisodeFormatError:
        return None


HELP = CommandHelp(
    examples=(
        ("EPISODES --detector RUN --boxes compact", "3-D boxes by a trained network, from 2-D boxes of compact"),
        ("EPISODES --detector MEMORY_RUN --views 4", "from four views together, by a run of labeling.train3d --memory"),
        ("EPISODES --detector FLOW_RUN", "what moves from each view to the next, by a run of labeling.train_flow"),
        ("EPISODES --detector ldls", "without training"),
    ),
)
main = make_main("labeling.detect3d", Detect3dCommand, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
