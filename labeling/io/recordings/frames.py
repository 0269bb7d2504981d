"""The frames of a recording, whatever its layout: choosing among them, and reading their pictures."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float

from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import is_rigid
from labeling.core.views import RgbdViews
from labeling.io.recordings.floor import MAX_VIEWS, floor_normal
from labeling.io.recordings.pictures import (
    Undistortion,
    enlarge_depth,
    read_colour,
    read_depth,
    register_depth,
    reproject_depth,
    same_view,
    size_text,
)
from labeling.io.recordings.recording_config import FLOOR, RecordingConfig, up_direction
from labeling.runtime.progress import view_counter
from labeling.runtime.threads import as_they_come

MAX_DEPTH_UNIT_M = 1000.0


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
    """K of the depth picture; None if it shows what the colour picture shows."""
    depth_to_colour: Float[np.ndarray, "4 4"] | None = None
    """Transform of points from the depth camera's frame to the colour camera's; None if both stand at one place."""
    distortion: tuple[float, ...] = ()
    """OpenCV's k1 k2 p1 p2 k3; empty for a straight picture."""


@dataclass(frozen=True)
class FrameList:
    """What a layout found in a folder."""

    names: tuple[str, ...]
    """Colour files of all frames, in order, also of those that cannot be used."""
    frames: list[Frame]
    """Those that can be used."""
    notes: list[str]
    """What was left out, and why."""


def frame_list(found: Sequence[tuple[str, Frame | str]], reasons: Sequence[str], problem: str, hint: str) -> FrameList:
    """The frames of a recording, with one note for each reason why some were left out.

    Args:
        found: colour file, and its frame or the reason why it cannot be used, such as "without depth".
        reasons: in the order of the notes.
        problem: what is wrong if no frame can be used.
        hint: what to do then.

    Raises:
        EpisodeFormatError: if no frame can be used.
    """
    frames = [frame for _, frame in found if isinstance(frame, Frame)]
    if not frames:
        counts = ", ".join(f"{sum(frame == reason for _, frame in found)} {reason}" for reason in reasons)
        raise EpisodeFormatError(f"{problem} ({counts}); {hint}")
    notes = []
    for reason in reasons:
        names = [name for name, frame in found if frame == reason]
        if names:
            more = f" and {len(names) - 3} more" if len(names) > 3 else ""
            plural = "s" if len(names) > 1 else ""
            notes.append(f"left out {len(names)} frame{plural} {reason}: {', '.join(names[:3])}{more}")
    return FrameList(tuple(name for name, _ in found), frames, notes)


def depth_to_colour(matrix: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"] | None:
    """A transform from the depth camera's frame to the colour camera's; None for one that moves nothing.

    Raises:
        ValueError: if it is not rigid.
    """
    if not is_rigid(matrix):
        raise ValueError("is not a rigid transform (a rotation, a translation in metres, a last row 0 0 0 1)")
    return None if np.allclose(matrix, np.eye(4), atol=1e-6) else matrix


def file_inside(folder: Path, relative: str, extensions: Sequence[str] = ()) -> Path:
    """The file of a recording that one of its other files names.

    Args:
        folder: the recording.
        relative: the name; an absolute one must lead into the folder.
        extensions: tried in turn where the name lacks its extension.

    Raises:
        ValueError: if it is no file name, leads out of the recording or does not exist.
    """
    try:
        path = folder / PurePosixPath(relative)
        if PurePosixPath(relative).is_absolute() and path.resolve().is_relative_to(folder.resolve()):
            path = folder / path.resolve().relative_to(folder.resolve())
        if not path.is_file():
            path = next((found for e in extensions if (found := path.with_name(path.name + e)).is_file()), path)
        leads_out, exists = not path.resolve().is_relative_to(folder.resolve()), path.is_file()
    except (OSError, UnicodeError, RuntimeError, ValueError):  # too long, not a file name, links in a circle, no name
        raise ValueError(f"{relative!r} cannot be a file name") from None
    if leads_out:
        raise ValueError(f"{relative!r} leads out of the recording's folder")
    if not exists:
        raise ValueError(f"{relative!r} does not exist")
    return path


def choose(found: FrameList, config: RecordingConfig, folder: Path) -> FrameList:
    """The frames that ``--every`` and ``--max-views`` leave, turned so that +Z is up.

    Raises:
        EpisodeFormatError: if up is to be found from the floor of this folder's recording, and there is none.
    """
    frames, notes = found.frames[:: config.every], list(found.notes)
    if len(frames) > config.max_views:
        kept = np.rint(np.linspace(0, len(frames) - 1, config.max_views)).astype(int)
        notes.append(f"took {config.max_views} of {len(frames)} frames, spread evenly (--max-views, --every)")
        frames = [frames[index] for index in kept]
    if config.up != "z":
        direction = _floor(frames, folder) if config.up == FLOOR else np.array(up_direction(config.up))
        if config.up == FLOOR:
            told = ",".join(f"{value:.4f}" for value in direction)
            notes.append(f"the floor's normal was taken for up: --up={told}")
        turn = _turn_up(direction)
        frames = [replace(frame, camera_to_world=turn @ frame.camera_to_world) for frame in frames]
    hint = _other_up(frames)
    if hint and config.up == "z":
        notes.append(f"the cameras' own up is the recording's {hint} axis; if that is so, say --up={hint}")
    notes += _far_away(frames)
    return FrameList(found.names, frames, notes)


FAR_M, FAR_SPREADS = 100.0, 20.0
"""A view this far from the middle of all views, and so many times the median distance, is told of."""


def _far_away(frames: Sequence[Frame]) -> list[str]:
    """A note if some views stand nowhere near the others: as a rule their poses are wrong."""
    places = np.array([frame.camera_to_world[:3, 3] for frame in frames]).reshape(-1, 3)
    away = np.linalg.norm(places - np.median(places, axis=0), axis=1) if len(places) else np.zeros(0)
    far = np.flatnonzero(away > max(FAR_M, FAR_SPREADS * float(np.median(away)) if len(away) else 0.0))
    if not len(far):
        return []
    names = ", ".join(frames[index].name for index in far[:3]) + (", ..." if len(far) > 3 else "")
    return [f"{len(far)} of {len(frames)} views stand up to {away[far].max():,.0f} m from the others: {names}"]


def _floor(frames: Sequence[Frame], folder: Path) -> Float[np.ndarray, "3"]:
    """The normal of the floor, from a few of the frames."""
    kept = np.unique(np.rint(np.linspace(0, len(frames) - 1, MAX_VIEWS)).astype(int))
    normal = floor_normal(load([frames[index] for index in kept], undistort=True)[0])
    if normal is None:
        raise EpisodeFormatError(
            f"{folder}: no plane clearly is its floor (large, below most cameras, facing the upper edge of the "
            "pictures); say which way is up: --up=X,Y,Z"
        )
    return normal


def load(
    frames: Sequence[Frame], undistort: bool
) -> tuple[RgbdViews, tuple[Undistortion | None, ...], tuple[str, ...]]:
    """Reads the pictures.

    Args:
        frames: at least one.
        undistort: remove lens distortion; without it distorted pictures are refused.

    Returns:
        The views; for each what its lens distortion was removed with, None if it had none; and what there is to note.

    Raises:
        EpisodeFormatError: naming the file.
    """
    rgb, depth_m = np.zeros((0, 0, 0, 3), np.uint8), np.zeros((0, 0, 0), np.float32)
    intrinsics, undistortions = [], []
    resized, read = 0, view_counter("reading", len(frames))
    pictures = as_they_come(lambda frame: (read_colour(frame.colour_file), _read_depth(frame)), frames)
    with closing(pictures):
        for view, (frame, (colour, depth_or_error)) in enumerate(zip(frames, pictures, strict=True)):
            if view == 0:
                rgb = np.empty((len(frames), *colour.shape), np.uint8)
                depth_m = np.empty((len(frames), *colour.shape[:2]), np.float32)
            elif colour.shape != rgb.shape[1:]:
                raise EpisodeFormatError(
                    f"{frame.colour_file}: is {size_text(colour)} pixels, but the first view is {size_text(rgb[0])}; "
                    "all views of an episode have one size"
                )
            camera = frame.camera((colour.shape[0], colour.shape[1]))
            if isinstance(depth_or_error, EpisodeFormatError):
                raise depth_or_error
            aligned = _align(frame, depth_or_error, camera, colour.shape[:2])
            resized += aligned is not depth_or_error
            undistortion = None
            if any(frame.distortion):
                if not undistort:
                    raise EpisodeFormatError(
                        f"{frame.colour_file}: its camera has lens distortion (k1 k2 p1 p2 k3 = "
                        f"{', '.join(f'{value:g}' for value in frame.distortion)}); write straight pictures first: "
                        "python -m labeling.convert FOLDER --undistort --out EPISODE"
                    )
                undistortion = Undistortion(camera, frame.distortion, colour.shape[:2])
                colour = undistortion.colour(colour)
                if frame.depth_intrinsics is None:  # else it was brought into the straight picture already
                    aligned = undistortion.depth(aligned)
            rgb[view], depth_m[view] = colour, aligned
            intrinsics.append(camera)
            undistortions.append(undistortion)
            read(1)
    notes = (f"depth of {resized} views was brought into their colour pictures",) if resized else ()
    poses = np.stack([frame.camera_to_world for frame in frames])
    views = RgbdViews(rgb, depth_m, np.stack(intrinsics), poses)
    return views, tuple(undistortions), notes


def _read_depth(frame: Frame) -> np.ndarray | EpisodeFormatError:
    """Depth, or what is wrong with it: told only after what is wrong with the colour picture."""
    try:
        return read_depth(frame.depth_file, frame.depth_unit_m)
    except EpisodeFormatError as error:
        return error


def _align(frame: Frame, depth_m, camera, size: tuple[int, int]) -> np.ndarray:
    same_camera = frame.depth_intrinsics is None or np.array_equal(frame.depth_intrinsics, camera)
    same_camera &= frame.depth_to_colour is None
    if depth_m.shape == size and same_camera:
        return depth_m
    if frame.depth_intrinsics is not None and frame.depth_to_colour is not None:
        return reproject_depth(depth_m, frame.depth_intrinsics, frame.depth_to_colour, camera, size)
    if frame.depth_intrinsics is not None:
        return register_depth(depth_m, frame.depth_intrinsics, camera, size)
    if not same_view((depth_m.shape[0], depth_m.shape[1]), size):
        raise EpisodeFormatError(
            f"{frame.depth_file}: depth is {size_text(depth_m)} pixels but its colour picture is {size[1]}x{size[0]}, "
            "which is no enlargement of it: it was taken by a camera of its own; tell of that one (see "
            'docs/your-own-recordings.md, "Depth from a camera of its own"), or align depth to colour first'
        )
    return enlarge_depth(depth_m, size)


def _turn_up(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """The rotation that brings a direction to +Z, by the shortest way; half a turn about X for what points down."""
    x, y, z = up / np.linalg.norm(up)
    turn = np.diag([1.0, -1.0, -1.0, 1.0])
    if z > -1 + 1e-9:
        cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
        turn[:3, :3] = np.eye(3) + cross + cross @ cross / (1 + z)
    return turn


def _other_up(frames: Sequence[Frame]) -> str | None:
    """The axis along which the cameras hold their upper edge, where it clearly is another one than +Z."""
    up = -np.mean([frame.camera_to_world[:3, 1] for frame in frames], axis=0)
    axis = int(np.abs(up).argmax())
    if abs(up[axis]) < 0.8 or (axis == 2 and up[2] > 0):
        return None
    return ("" if up[axis] > 0 else "-") + "xyz"[axis]
