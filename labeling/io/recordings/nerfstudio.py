"""``transforms.json`` folders: nerfstudio's own, and Record3D and Polycam exports made for it.

Source: nerfstudio, "Data conventions" (docs.nerf.studio) and its data parser: OpenGL camera axes; intrinsics shared or
per frame; ``k1 k2 k3 p1 p2`` are OpenCV's; ``applied_transform`` is already in the poses; ``applied_scale`` is the
factor their translations were multiplied with. nerfstudio's depth is registered to colour; other depth comes with
fields of ours, ``depth_fl_x depth_fl_y depth_cx depth_cy`` and ``depth_to_color``.
"""

import functools
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.geometry import flip_camera_axes, intrinsics_matrix, is_rigid
from labeling.formats.checked_json import Json, read_json
from labeling.io.recordings.frames import MAX_DEPTH_UNIT_M, Frame, FrameList, depth_to_colour, file_inside, frame_list
from labeling.io.recordings.recording_config import RecordingConfig

FILES = ("transforms.json",)
DEPTH_UNIT_M = 0.001
EXTENSIONS = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")
CAMERA_MODELS = ("PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "PERSPECTIVE", "SIMPLE_RADIAL", "RADIAL")
NO_DEPTH = "without depth_file_path"
DEPTH_CAMERA, DEPTH_TO_COLOUR = ("depth_fl_x", "depth_fl_y", "depth_cx", "depth_cy"), "depth_to_color"
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")


def list_frames(folder: Path, config: RecordingConfig) -> FrameList:
    """Lists the frames of a ``transforms.json``.

    Raises:
        EpisodeFormatError: naming file and field, if anything is missing or malformed.
    """
    transforms = read_json(folder / "transforms.json")
    records = transforms.list_of("frames")
    if not records:
        raise transforms.error("has no frames; an episode needs at least one view", "frames")
    depth_unit_m = config.depth_unit_m or transforms.number("depth_unit_scale_factor", DEPTH_UNIT_M, above=0.0)
    if depth_unit_m > MAX_DEPTH_UNIT_M:
        problem = f"is metres per unit of depth; {depth_unit_m:g} is more than the {MAX_DEPTH_UNIT_M:g} accepted"
        raise transforms.error(problem, "depth_unit_scale_factor")
    scale = _applied_scale(transforms)
    found: list[tuple[str, Frame | str]] = []
    for record in records:
        colour_file = _inside(folder, record, "file_path", EXTENSIONS)
        name = colour_file.relative_to(folder).as_posix()
        if not record.has("depth_file_path"):
            found.append((name, NO_DEPTH))
            continue
        pose = _camera_to_world(record)
        pose[:3, 3] /= scale
        depth_camera, transform = _depth_camera(transforms, record)
        frame = Frame(
            name=name,
            colour_file=colour_file,
            depth_file=_inside(folder, record, "depth_file_path", (*EXTENSIONS, ".npy")),
            depth_unit_m=depth_unit_m,
            camera_to_world=pose,
            camera=functools.partial(_intrinsics, transforms, record, name),
            depth_intrinsics=depth_camera,
            depth_to_colour=transform,
            distortion=_distortion(transforms, record),
        )
        found.append((name, frame))
    problem = f"{records[0].where('depth_file_path')}: is missing, as in every frame"
    return frame_list(found, [NO_DEPTH], problem, "labels need depth, so export the recording with its depth pictures")


def _inside(folder: Path, record: Json, name: str, extensions: tuple[str, ...]) -> Path:
    """The file a frame refers to, which may be named without its extension."""
    relative = record.text(name)
    try:
        return file_inside(folder, relative, extensions)
    except ValueError as error:
        raise record.error(str(error), name) from None


def _intrinsics(transforms: Json, record: Json, file: str, size: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    holder = functools.partial(_holder, transforms, record)
    height_px, width_px = size
    for name, side in (("w", width_px), ("h", height_px)):
        if holder(name).has(name) and (stated := holder(name).number(name)) != side:
            raise holder(name).error(f"says {stated:g} pixels, but {file} has {side}", name)
    if not holder("fl_x").has("fl_x") and holder("camera_angle_x").has("camera_angle_x"):
        # Blender and instant-ngp: square pixels, the principal point in the middle unless told.
        angle = holder("camera_angle_x").number("camera_angle_x", above=0.0)
        focal = 0.5 * width_px / np.tan(0.5 * min(angle, 3.0))
        centre = [holder(name).number(name, 0.5 * (side - 1)) for name, side in (("cx", width_px), ("cy", height_px))]
        return intrinsics_matrix(focal, focal, *centre)
    fl_x, fl_y = (holder(name).number(name, above=0.0) for name in ("fl_x", "fl_y"))
    cx, cy = (holder(name).number(name) for name in ("cx", "cy"))
    return intrinsics_matrix(fl_x, fl_y, cx, cy)


def _depth_camera(
    transforms: Json, record: Json
) -> tuple[Float[np.ndarray, "3 3"] | None, Float[np.ndarray, "4 4"] | None]:
    """K of the depth camera, and the transform from its frame to colour's; None where depth is registered."""
    holder = functools.partial(_holder, transforms, record)
    has_transform = holder(DEPTH_TO_COLOUR).has(DEPTH_TO_COLOUR)
    if not has_transform and not any(holder(name).has(name) for name in DEPTH_CAMERA):
        return None, None
    focal = [holder(name).number(name, above=0.0) for name in DEPTH_CAMERA[:2]]
    camera = intrinsics_matrix(*focal, *(holder(name).number(name) for name in DEPTH_CAMERA[2:]))
    if not has_transform:
        return camera, None
    matrix = holder(DEPTH_TO_COLOUR).array(DEPTH_TO_COLOUR, (4, 4))
    try:
        return camera, depth_to_colour(matrix)
    except ValueError as error:
        raise holder(DEPTH_TO_COLOUR).error(str(error), DEPTH_TO_COLOUR) from None


def _holder(transforms: Json, record: Json, name: str) -> Json:
    """Where a value stands: in the frame's own record if it has it, else in that of the whole recording."""
    return record if record.has(name) else transforms


def _distortion(transforms: Json, record: Json) -> tuple[float, ...]:
    holder = functools.partial(_holder, transforms, record)
    stated = holder("camera_model")
    if stated.has("camera_model") and (model := stated.text("camera_model")) not in CAMERA_MODELS:
        problem = f"{model!r} is not supported; undistort the pictures to one of {', '.join(CAMERA_MODELS)}"
        raise stated.error(problem, "camera_model")
    if holder("k4").number("k4", 0.0):
        raise holder("k4").error("fisheye cameras are not supported", "k4")
    values = tuple(holder(name).number(name, 0.0) for name in _DISTORTION)
    return values if any(values) else ()


def _camera_to_world(record: Json) -> Float[np.ndarray, "4 4"]:
    matrix = record.array("transform_matrix", (4, 4))
    if not is_rigid(matrix):
        raise record.error(
            "is not a rigid transform (a rotation, a translation and a last row 0 0 0 1)", "transform_matrix"
        )
    return flip_camera_axes(matrix)


def _applied_scale(transforms: Json) -> float:
    """The factor that poses were scaled with; a scale hidden in ``applied_transform`` is refused."""
    if transforms.has("applied_transform"):
        value = transforms.get("applied_transform").value
        rows = 4 if isinstance(value, list) and len(value) == 4 else 3
        matrix = np.eye(4)
        matrix[:rows] = transforms.array("applied_transform", (rows, 4))
        if not is_rigid(matrix):
            raise transforms.error(
                "is more than a rotation and a translation, so the poses would not be in metres", "applied_transform"
            )
    return transforms.number("applied_scale", 1.0, above=0.0)
