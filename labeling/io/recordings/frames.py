"""The frames of a recording, whatever its layout: choosing among them, and reading their pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.errors import EpisodeFormatError
from labeling.core.views import RgbdViews
from labeling.io.recordings.pictures import (
    Straightening,
    enlarge_depth,
    read_colour,
    read_depth,
    register_depth,
    same_view,
    size_text,
)
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.threads import in_threads

MAX_DEPTH_UNIT_M = 1000.0
_UP = {"z": (0, 0, 1), "y": (0, 1, 0), "x": (1, 0, 0), "-z": (0, 0, -1), "-y": (0, -1, 0), "-x": (-1, 0, 0)}


@dataclass(frozen=True)
class Frame:
    """One view of a recording, its pictures not yet read."""

    name: str
    """The colour file, relative to the recording."""
    colour_file: Path
    depth_file: Path
    depth_unit_m: float
    camera_to_world: Float[np.ndarray, "4 4"]
    """OpenCV camera axes."""
    camera: Callable[[tuple[int, int]], Float[np.ndarray, "3 3"]]
    """K for a colour picture of this height and width; refuses a size that the recording contradicts."""
    depth_intrinsics: Float[np.ndarray, "3 3"] | None = None
    """K of the depth picture, from the same place as colour; None if it shows what the colour picture shows."""
    distortion: tuple[float, ...] = ()
    """OpenCV's k1 k2 p1 p2 k3; empty for a straight picture."""


@dataclass(frozen=True)
class FrameList:
    """What a layout found in a folder."""

    names: tuple[str, ...]
    """Colour files of all frames, in order, also of those that cannot be used."""
    frames: list[Frame]
    """Those that can be used."""
    notes: list[str] = field(default_factory=list)
    """What was left out, and why."""


@dataclass(frozen=True)
class LoadedViews:
    """The views of the frames chosen."""

    views: RgbdViews
    straightening: tuple[Straightening | None, ...]
    """For each view what has straightened it; None if it was straight already."""
    notes: list[str]


def choose(found: FrameList, config: RecordingConfig) -> FrameList:
    """The frames that ``--every`` and ``--max-views`` leave, turned so that +Z is up."""
    frames, notes = found.frames[:: config.every], list(found.notes)
    if len(frames) > config.max_views:
        kept = np.rint(np.linspace(0, len(frames) - 1, config.max_views)).astype(int)
        notes.append(f"took {config.max_views} of {len(frames)} frames, spread evenly (--max-views, --every)")
        frames = [frames[index] for index in kept]
    turn = _turn_up(config)
    if config.up != "z":
        frames = [replace(frame, camera_to_world=turn @ frame.camera_to_world) for frame in frames]
    hint = _other_up(frames)
    if hint and config.up == "z":
        notes.append(f"the cameras' own up is the recording's {hint} axis; if that is so, say --up={hint}")
    return FrameList(found.names, frames, notes)


def load(frames: Sequence[Frame], straighten: bool) -> LoadedViews:
    """Reads the pictures.

    Args:
        frames: at least one.
        straighten: remove lens distortion; without it distorted pictures are refused.

    Raises:
        EpisodeFormatError: naming the file.
    """
    rgb: list[np.ndarray] = []
    depth, intrinsics, straightening = [], [], []
    resized = 0
    pictures = in_threads(lambda frame: (read_colour(frame.colour_file), _read_depth(frame)), frames)
    for frame, (colour, depth_or_error) in zip(frames, pictures, strict=True):
        if rgb and colour.shape != rgb[0].shape:
            raise EpisodeFormatError(
                f"{frame.colour_file}: is {size_text(colour)} pixels, but the first view is {size_text(rgb[0])}; "
                "all views of an episode have one size"
            )
        camera = frame.camera((colour.shape[0], colour.shape[1]))
        if isinstance(depth_or_error, EpisodeFormatError):
            raise depth_or_error
        depth_m = depth_or_error
        aligned = _align(frame, depth_m, camera, colour.shape[:2])
        resized += aligned is not depth_m
        lens = None
        if any(frame.distortion):
            if not straighten:
                raise EpisodeFormatError(
                    f"{frame.colour_file}: its camera has lens distortion (k1 k2 p1 p2 k3 = "
                    f"{', '.join(f'{value:g}' for value in frame.distortion)}); write straight pictures first: "
                    "python -m labeling.convert FOLDER --undistort --out EPISODE"
                )
            lens = Straightening(camera, frame.distortion, colour.shape[:2])
            colour, aligned = lens.colour(colour), lens.depth(aligned)
        rgb.append(colour)
        depth.append(aligned)
        intrinsics.append(camera)
        straightening.append(lens)
    notes = [f"depth of {resized} views was brought to the size of their colour pictures"] if resized else []
    poses = np.stack([frame.camera_to_world for frame in frames])
    views = RgbdViews(np.stack(rgb), np.stack(depth), np.stack(intrinsics), poses)
    return LoadedViews(views, tuple(straightening), notes)


def _read_depth(frame: Frame) -> np.ndarray | EpisodeFormatError:
    """Depth, or what is wrong with it: told only after what is wrong with the colour picture."""
    try:
        return read_depth(frame.depth_file, frame.depth_unit_m)
    except EpisodeFormatError as error:
        return error


def _align(frame: Frame, depth_m, camera, size: tuple[int, int]) -> np.ndarray:
    if frame.depth_intrinsics is not None and not (
        depth_m.shape == size and np.array_equal(frame.depth_intrinsics, camera)
    ):
        return register_depth(depth_m, frame.depth_intrinsics, camera, size)
    if depth_m.shape == size:
        return depth_m
    if not same_view((depth_m.shape[0], depth_m.shape[1]), size):
        raise EpisodeFormatError(
            f"{frame.depth_file}: depth is {size_text(depth_m)} pixels but its colour picture is {size[1]}x{size[0]}, "
            "which is no enlargement of it; align depth to colour first"
        )
    return enlarge_depth(depth_m, size)


def _turn_up(config: RecordingConfig) -> Float[np.ndarray, "4 4"]:
    """The rotation that brings the recording's up axis to +Z, by the shortest way."""
    up, turn = np.array(_UP[config.up], float), np.eye(4)
    if config.up == "-z":
        turn[:3, :3] = np.diag([1.0, -1.0, -1.0])
        return turn
    axis = np.cross(up, [0.0, 0.0, 1.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn[:3, :3] = np.eye(3) + cross + cross @ cross / (1 + up[2])
    return turn


def _other_up(frames: Sequence[Frame]) -> str | None:
    """The axis along which the cameras hold their upper edge, where it clearly is another one than +Z."""
    up = -np.mean([frame.camera_to_world[:3, 1] for frame in frames], axis=0)
    axis = int(np.abs(up).argmax())
    if abs(up[axis]) < 0.8 or (axis == 2 and up[2] > 0):
        return None
    return ("" if up[axis] > 0 else "-") + "xyz"[axis]


def leave_out_note(names: Sequence[str], reason: str) -> str:
    """One line about frames that cannot be used."""
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return f"left out {len(names)} frame{'s' if len(names) > 1 else ''} {reason}: {', '.join(names[:3])}{more}"
