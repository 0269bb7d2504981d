"""Which layout a folder has."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.io.recordings import nerfstudio, scannet, tum
from labeling.io.recordings.frames import FrameList, choose
from labeling.io.recordings.recording_config import RecordingConfig


@dataclass(frozen=True)
class Layout:
    """One way to lay out a recording in a folder."""

    name: str
    title: str
    marks: tuple[str, ...]
    """Files and folders that all must be there."""
    list_frames: Callable[[Path, RecordingConfig], FrameList]

    def missing(self, folder: Path) -> list[str]:
        """The marks that are not there."""
        return [mark for mark in self.marks if not (folder / mark).exists()]


LAYOUTS = (
    Layout("nerfstudio", "nerfstudio, Record3D, Polycam", nerfstudio.FILES, nerfstudio.list_frames),
    Layout("tum", "TUM RGB-D", tum.FILES, tum.list_frames),
    Layout("scannet", "ScanNet export", scannet.FILES, scannet.list_frames),
)


def layout_of(folder: Path, config: RecordingConfig) -> Layout | None:
    """The layout of a folder, or None if it is no recording."""
    candidates = [layout for layout in LAYOUTS if config.layout in ("auto", layout.name)]
    return next((layout for layout in candidates if not layout.missing(folder)), None)


def expected_files(folder: Path, config: RecordingConfig) -> str:
    """The files that make a folder a recording, and which of them it lacks, for messages."""
    parts = []
    for layout in LAYOUTS:
        if config.layout in ("auto", layout.name):
            missing = layout.missing(folder)
            lack = "" if len(missing) == len(layout.marks) else f" (missing: {', '.join(missing)})"
            parts.append(f"{' '.join(layout.marks)} for {layout.title}{lack}")
    return "; ".join(parts)


def frames_of(folder: Path, config: RecordingConfig) -> FrameList:
    """Lists and chooses the frames of a recording.

    Raises:
        EpisodeFormatError: if it is no recording or a malformed one.
        UsageError: if a setting does not fit its layout.
    """
    config.check()
    layout = layout_of(folder, config)
    if layout is None:
        if not folder.is_dir():
            raise EpisodeFormatError(f"{folder}: no such folder")
        raise EpisodeFormatError(f"{folder}: no recording here; looked for {expected_files(folder, config)}")
    if config.camera is not None and layout.name != "tum":
        raise UsageError(f"--camera is for TUM folders; {folder} tells its camera itself")
    return choose(layout.list_frames(folder, config), config, folder)
