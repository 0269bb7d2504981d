"""Folders as ScanNet's SensReader exports them: ``color/ depth/ pose/ intrinsic/``, files numbered alike.

Source: ScanNet, SensReader: ``pose/N.txt`` is camera to world (4x4, OpenCV axes, -inf where tracking was lost); depth
is in millimetres and in the pixels of the depth camera, which ``intrinsic_depth.txt`` describes;
``extrinsic_color.txt`` and ``extrinsic_depth.txt`` lead from the frame of either camera to the one that poses are of.
"""

import functools
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import intrinsics_matrix, invert_rigid, is_rigid
from labeling.io.recordings.frames import Frame, FrameList, depth_to_colour, frame_list
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.io.recordings.text_tables import read_matrix

FILES = ("color", "depth", "pose", "intrinsic")
DEPTH_UNIT_M = 0.001
_PICTURES = (".png", ".jpg", ".jpeg", ".npy")


def list_frames(folder: Path, config: RecordingConfig) -> FrameList:
    """Lists the colour pictures that have depth and a tracked pose.

    Raises:
        EpisodeFormatError: naming the file, if anything is missing or malformed.
    """
    camera_file = folder / "intrinsic" / "intrinsic_color.txt"
    camera = _intrinsics(camera_file)
    depth_file = folder / "intrinsic" / "intrinsic_depth.txt"
    depth_camera = _intrinsics(depth_file) if depth_file.is_file() else None
    colour_to_body, depth_to_body = (
        _extrinsics(folder / "intrinsic" / f"extrinsic_{name}.txt") for name in ("color", "depth")
    )
    transform = depth_to_colour(invert_rigid(colour_to_body) @ depth_to_body)
    if transform is not None and depth_camera is None:
        raise EpisodeFormatError(f"{depth_file}: is missing, but extrinsic_color.txt and extrinsic_depth.txt differ")
    colour, depth = _numbered(folder / "color", _PICTURES[:3]), _numbered(folder / "depth", _PICTURES)
    poses = _numbered(folder / "pose", (".txt",))
    if not colour:
        raise EpisodeFormatError(f"{folder / 'color'}: holds no PNG or JPEG picture")
    no_depth, no_pose = "without depth", "without a pose (tracking lost)"
    found: list[tuple[str, Frame | str]] = []
    for stem, file in colour.items():
        name = file.relative_to(folder).as_posix()
        pose = _pose(poses[stem]) if stem in poses else None
        frame: Frame | str = no_pose if stem in depth else no_depth
        if stem in depth and pose is not None:
            frame = Frame(
                name=name,
                colour_file=file,
                depth_file=depth[stem],
                depth_unit_m=config.depth_unit_m or DEPTH_UNIT_M,
                camera_to_world=pose @ colour_to_body,
                camera=functools.partial(_checked_size, camera, camera_file),
                depth_intrinsics=depth_camera,
                depth_to_colour=transform,
            )
        found.append((name, frame))
    problem = f"{folder}: none of the {len(colour)} pictures in color/ has both depth and a pose"
    return frame_list(found, [no_depth, no_pose], problem, "files of one view have the same number in their names")


def _checked_size(intrinsics: Float[np.ndarray, "3 3"], file: Path, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """K; refuses pictures that were resized after calibration, as many copies of ScanNet are."""
    centre, middle = intrinsics[:2, 2], 0.5 * (np.array(size[::-1]) - 1)
    if np.any(np.abs(centre - middle) > 0.25 * np.array(size[::-1])):
        raise EpisodeFormatError(
            f"{file}: its principal point {np.round(centre, 1).tolist()} is far from the middle of the "
            f"{size[1]}x{size[0]} pictures; they were resized, so scale the matrix by the same factor"
        )
    return intrinsics


def _intrinsics(path: Path) -> Float[np.ndarray, "3 3"]:
    matrix = read_matrix(path)
    if matrix.shape not in ((3, 3), (4, 4), (3, 4)) or not min(matrix[0, 0], matrix[1, 1]) > 0:
        raise EpisodeFormatError(f"{path}: expected a camera matrix (4x4 or 3x3, focal lengths above 0)")
    return intrinsics_matrix(matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])


def _extrinsics(path: Path) -> Float[np.ndarray, "4 4"]:
    """From a camera's frame to the one that poses are of; the same frame if the file is not there."""
    if not path.is_file():
        return np.eye(4)
    matrix = read_matrix(path)
    if matrix.shape != (4, 4) or not is_rigid(matrix):
        raise EpisodeFormatError(
            f"{path}: is not a 4x4 rigid transform (a rotation, a translation in metres, a last row 0 0 0 1)"
        )
    return matrix


def _pose(path: Path) -> Float[np.ndarray, "4 4"] | None:
    """A pose; None where tracking was lost, which is written as -inf (or NaN)."""
    matrix = read_matrix(path, finite=False)
    if matrix.shape != (4, 4):
        raise EpisodeFormatError(f"{path}: a pose is 4x4 numbers, not {matrix.shape}")
    if not np.all(np.isfinite(matrix)):
        return None
    if not is_rigid(matrix):
        raise EpisodeFormatError(f"{path}: is not a rigid transform (a rotation, a translation, a last row 0 0 0 1)")
    return matrix


def _numbered(folder: Path, extensions: tuple[str, ...]) -> dict[str, Path]:
    """Files by their names without what says what kind they are (``000017`` of ``000017.color.jpg``) and, of names that
    are numbers, without leading zeros: ``color/000017.jpg`` and ``depth/17.png`` are of one view. In the order of the
    numbers in the names.

    Raises:
        EpisodeFormatError: if the folder is missing, or two files have one name.
    """
    if not folder.is_dir():
        raise EpisodeFormatError(f"{folder}: folder is missing")
    files = [file for file in folder.iterdir() if file.suffix.lower() in extensions and not file.name.startswith(".")]
    files.sort(key=lambda file: ([int(number) for number in re.findall(r"\d+", file.stem)], file.name))
    found: dict[str, Path] = {}
    for file in files:
        stem = re.sub(r"\.[A-Za-z]\w*$", "", file.stem)
        stem = re.sub(r"^0+(?=[0-9]+$)", "", stem)
        if stem in found:
            raise EpisodeFormatError(f"{found[stem]} and {file.name}: are both {stem!r}; one view has one file here")
        found[stem] = file
    return found
