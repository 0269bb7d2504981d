"""Folders as the TUM RGB-D benchmark has them: ``rgb.txt``, ``depth.txt`` and ``groundtruth.txt`` with time stamps.

Source: TUM, "File formats" and "Intrinsic camera calibration" of the RGB-D SLAM dataset: depth in units of 1/5000 m,
registered to colour; poses ``timestamp tx ty tz qx qy qz qw`` of the colour camera (OpenCV axes) in the world.
Depth that is not registered comes with two files of ours, ``depth_intrinsics.txt`` and ``depth_to_color.txt``.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64

from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import intrinsics_matrix
from labeling.io.recordings.frames import Frame, FrameList, depth_to_colour, file_inside, frame_list
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.io.recordings.text_tables import read_matrix, read_rows, real_numbers

FILES = ("rgb.txt", "depth.txt", "groundtruth.txt")
DEPTH_UNIT_M = 1 / 5000
INTRINSICS_FILE, DEPTH_INTRINSICS_FILE = "intrinsics.txt", "depth_intrinsics.txt"
DEPTH_TO_COLOUR_FILE = "depth_to_color.txt"


def list_frames(folder: Path, config: RecordingConfig) -> FrameList:
    """Lists the colour pictures that have depth and pose close in time.

    Raises:
        EpisodeFormatError: naming file and line, if anything is missing or malformed.
    """
    camera = _intrinsics(folder, config)
    depth_camera, transform = _depth_camera(folder)
    colour_s, colour = _pictures(folder / "rgb.txt")
    depth_s, depth = _pictures(folder / "depth.txt")
    trajectory_s, trajectory = _trajectory(folder / "groundtruth.txt")
    partner = associate(colour_s, depth_s, config.max_gap_s)
    no_depth, no_pose = (f"without {what} within {config.max_gap_s:g} s" for what in ("depth", "a pose"))
    found: list[tuple[str, Frame | str]] = []
    for index, name in enumerate(colour):
        pose = pose_at(colour_s[index], trajectory_s, trajectory, config.max_gap_s)
        frame: Frame | str = no_depth if partner[index] < 0 else no_pose
        if partner[index] >= 0 and pose is not None:
            frame = Frame(
                name=name,
                colour_file=folder / name,
                depth_file=folder / depth[partner[index]],
                depth_unit_m=config.depth_unit_m or DEPTH_UNIT_M,
                camera_to_world=pose,
                camera=lambda size: camera,
                depth_intrinsics=depth_camera,
                depth_to_colour=transform,
            )
        found.append((name, frame))
    problem = f"{folder / 'rgb.txt'}: none of its {len(colour)} pictures has depth and a pose close in time"
    return frame_list(found, [no_depth, no_pose], problem, "compare the time stamps, or raise --max-gap-s")


def associate(first_s: Float64[np.ndarray, "n"], second_s: Float64[np.ndarray, "m"], max_gap_s: float) -> np.ndarray:
    """For each time of the first list the index of its partner in the second, or -1; no partner serves twice.

    The closest pairs are formed first, as TUM's associate.py does.
    """
    partner = np.full(len(first_s), -1)
    if len(second_s) == 0:
        return partner
    reach = max_gap_s + 1e-9  # Unix times in double precision are exact to 0.2 microseconds only
    order = np.argsort(second_s, kind="stable")
    low = np.searchsorted(second_s[order], first_s - reach, "left")
    high = np.searchsorted(second_s[order], first_s + reach, "right")
    pairs = [(abs(first_s[i] - second_s[j]), i, j) for i in range(len(first_s)) for j in order[low[i] : high[i]]]
    taken = np.zeros(len(second_s), bool)
    for _, i, j in sorted(pairs):
        if partner[i] < 0 and not taken[j]:
            partner[i], taken[j] = j, True
    return partner


def pose_at(
    time_s: float, trajectory_s: Float64[np.ndarray, "n"], trajectory: Float[np.ndarray, "n 7"], max_gap_s: float
) -> Float[np.ndarray, "4 4"] | None:
    """The pose at a time, between the two samples around it; None if the nearest one is too far off in time.

    Position is interpolated linearly, orientation by the normalised mean of quaternions, which at the few degrees
    between samples is a slerp to within a thousandth of a degree.
    """
    from scipy.spatial.transform import Rotation

    after = int(np.searchsorted(trajectory_s, time_s))
    around = [i for i in (after - 1, after) if 0 <= i < len(trajectory_s)]
    around = [i for i in around if abs(trajectory_s[i] - time_s) <= max_gap_s + 1e-9]
    if not around:
        return None
    samples = trajectory[around].copy()
    weight = 0.0
    if len(around) == 2:
        weight = (time_s - trajectory_s[around[0]]) / max(trajectory_s[around[1]] - trajectory_s[around[0]], 1e-12)
        if samples[0, 3:] @ samples[1, 3:] < 0:  # q and -q are one rotation
            samples[1, 3:] *= -1
    mixed = (1 - weight) * samples[0] + weight * samples[-1]
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(mixed[3:]).as_matrix()
    pose[:3, 3] = mixed[:3]
    return pose


def _intrinsics(folder: Path, config: RecordingConfig) -> Float[np.ndarray, "3 3"]:
    if config.camera is not None:
        return intrinsics_matrix(*config.camera)
    if (folder / INTRINSICS_FILE).is_file():
        return _camera_matrix(folder / INTRINSICS_FILE)
    raise EpisodeFormatError(
        f"{folder}: TUM folders do not tell the camera; give --camera FX FY CX CY, or write these four numbers to "
        f"{INTRINSICS_FILE} (TUM recommends 525 525 319.5 239.5 for its own recordings)"
    )


def _depth_camera(folder: Path) -> tuple[Float[np.ndarray, "3 3"] | None, Float[np.ndarray, "4 4"] | None]:
    """K of the depth camera, and the transform from its frame to colour's; None where depth is registered."""
    intrinsics_file, transform_file = folder / DEPTH_INTRINSICS_FILE, folder / DEPTH_TO_COLOUR_FILE
    camera = _camera_matrix(intrinsics_file) if intrinsics_file.is_file() else None
    if not transform_file.is_file():
        return camera, None
    if camera is None:
        raise EpisodeFormatError(f"{intrinsics_file}: is missing, which {DEPTH_TO_COLOUR_FILE} needs beside it")
    matrix = read_matrix(transform_file)
    try:
        return camera, depth_to_colour(matrix if matrix.shape == (4, 4) else np.zeros((4, 4)))
    except ValueError as error:
        raise EpisodeFormatError(f"{transform_file}: {error}") from None


def _camera_matrix(path: Path) -> Float[np.ndarray, "3 3"]:
    """K of a file that holds it, or fx fy cx cy."""
    matrix = read_matrix(path)
    if matrix.shape != (3, 3) and matrix.size != 4:
        raise EpisodeFormatError(f"{path}: expected fx fy cx cy, or a 3x3 matrix, not shape {matrix.shape}")
    intrinsics = matrix if matrix.shape == (3, 3) else intrinsics_matrix(*matrix.ravel())
    if not min(intrinsics[0, 0], intrinsics[1, 1]) > 0:
        raise EpisodeFormatError(f"{path}: focal lengths must be above 0, not {np.diag(intrinsics)[:2].tolist()}")
    return intrinsics


def _pictures(path: Path) -> tuple[Float64[np.ndarray, "n"], list[str]]:
    """Time stamps and file names of ``rgb.txt`` or ``depth.txt``."""
    times, names = [], []
    for line, words in read_rows(path):
        if len(words) != 2:
            raise EpisodeFormatError(f"{path}: line {line}: expected 'timestamp file', not {len(words)} words")
        try:
            file = file_inside(path.parent, words[1])
        except ValueError as error:
            raise EpisodeFormatError(f"{path}: line {line}: {error}") from None
        times.append(real_numbers(path, line, words[:1])[0])
        names.append(file.relative_to(path.parent).as_posix())
    if not names:
        raise EpisodeFormatError(f"{path}: lists no picture")
    return np.array(times), names


def _trajectory(path: Path) -> tuple[Float64[np.ndarray, "n"], Float64[np.ndarray, "n 7"]]:
    rows = []
    for line, words in read_rows(path):
        numbers = real_numbers(path, line, words)
        if len(numbers) != 8:
            raise EpisodeFormatError(
                f"{path}: line {line}: expected 'timestamp tx ty tz qx qy qz qw', not {len(words)} numbers"
            )
        if not 0.9 < np.linalg.norm(numbers[4:]) < 1.1:
            raise EpisodeFormatError(f"{path}: line {line}: qx qy qz qw must be a unit quaternion")
        rows.append(numbers)
    if not rows:
        raise EpisodeFormatError(f"{path}: lists no pose")
    table = np.array(rows)
    table[:, 4:] /= np.linalg.norm(table[:, 4:], axis=1, keepdims=True)
    table = table[np.argsort(table[:, 0], kind="stable")]
    return table[:, 0], table[:, 1:]
