"""Folders as ScanNet's SensReader exports them: ``color/ depth/ pose/ intrinsic/``, files numbered alike.

Source: ScanNet, SensReader: ``pose/N.txt`` is camera to world (4x4, OpenCV axes, -inf where tracking was lost); depth
is in millimetres and in the pixels of the depth camera, which ``intrinsic_depth.txt`` describes.
"""

import functools
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import intrinsics_matrix, is_rigid
from labeling.io.recordings.frames import Frame, FrameList, frame_list
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
    _check_same_place(folder / "intrinsic")
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
                camera_to_world=pose,
                camera=functools.partial(_checked_size, camera, camera_file),
                depth_intrinsics=depth_camera,
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


def _check_same_place(folder: Path) -> None:
    """Refuses a depth camera that stands elsewhere than the colour camera."""
    files = [folder / "extrinsic_color.txt", folder / "extrinsic_depth.txt"]
    if not all(file.is_file() for file in files):
        return
    colour, depth = (read_matrix(file) for file in files)
    if colour.shape != depth.shape or not np.allclose(colour, depth, atol=1e-4):
        raise EpisodeFormatError(f"{files[0]}: differs from {files[1].name}; align depth to colour first")


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
    """Files by what stands before their first dot, in the order of the numbers in it."""
    if not folder.is_dir():
        raise EpisodeFormatError(f"{folder}: folder is missing")
    files = [file for file in folder.iterdir() if file.suffix.lower() in extensions and not file.name.startswith(".")]
    files.sort(key=lambda file: ([int(number) for number in re.findall(r"\d+", file.stem)], file.name))
    return {file.name.split(".")[0]: file for file in files}
