"""3-D boxes as KITTI's object benchmark has them: image_2, label_2 and calib, numbered views."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.geometry import invert_rigid, transform_points
from labeling.core.masks import box_xywh
from labeling.core.types import Box3d
from labeling.exports.pictures import write_png
from labeling.io.labelled_views import LabelledView, ViewLabel


def write_kitti(out: Path, views: Iterable[LabelledView]) -> int:
    """Writes ``image_2``, ``label_2``, ``calib`` and ``names.txt`` (the view of each number); returns how many boxes.

    KITTI's boxes turn about the camera's vertical axis alone. Cameras that look up or down are therefore written in a
    level frame at their place, +Y straight down: P2 has the rotation from it, so that it projects boxes to pixels, and
    Tr_velo_to_cam leads to it from the world. Labels without a 3-D box are left out; truncation and occlusion are
    unknown (-1); scores stand last, as in results.

    Args:
        out: an empty folder.
        views: to write; their world's +Z is up.
    """
    for kind in ("image_2", "label_2", "calib"):
        (out / kind).mkdir()
    names, count = [], 0
    for number, view in enumerate(views):
        level_to_world = level_frame(view.camera.camera_to_world)
        world_to_level = invert_rigid(level_to_world)
        projection = view.camera.intrinsics @ (view.camera.world_to_camera @ level_to_world)[:3]
        lines = [label_line(label, label.box_3d, world_to_level) for label in view.labels if label.box_3d is not None]
        write_png(out / "image_2" / f"{number:06d}.png", view.rgb)
        (out / "label_2" / f"{number:06d}.txt").write_text("".join(lines), encoding="utf-8")
        (out / "calib" / f"{number:06d}.txt").write_text(_calibration(projection, world_to_level), encoding="utf-8")
        names.append(f"{number:06d} {view.name}\n")
        count += len(lines)
    (out / "names.txt").write_text("".join(names), encoding="utf-8")
    return count


def level_frame(camera_to_world: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The frame at a camera's place whose +Y points straight down (world -Z), and +Z where the camera looks, level."""
    down = np.array([0.0, 0.0, -1.0])
    ahead = camera_to_world[:3, 2].copy()
    if np.linalg.norm(ahead[:2]) < 1e-6:
        # Straight up or down: what is above in the picture lies ahead.
        ahead = -camera_to_world[:3, 1]
    ahead[2] = 0.0
    ahead /= np.linalg.norm(ahead)
    level = np.eye(4)
    level[:3, :3] = np.stack([np.cross(down, ahead), down, ahead], axis=1)
    level[:3, 3] = camera_to_world[:3, 3]
    return level


def label_line(label: ViewLabel, box: Box3d, world_to_level: Float[np.ndarray, "4 4"]) -> str:
    """A line of a label file: type, truncated, occluded, alpha, 2-D box, size, place, rotation_y, score."""
    axes = world_to_level[:3, :3] @ box.rotation
    upright = int(np.abs(axes[1]).argmax())
    along, aside = (axis for axis in range(3) if axis != upright)
    # A turn of rotation_y about +Y (down) takes +X, along which KITTI measures length, to (cos, 0, -sin).
    rotation_y = float(np.arctan2(-axes[2, along], axes[0, along]))
    length, width, height = box.extent_m[[along, aside, upright]]
    (x, y, z) = transform_points(world_to_level, box.centre_m[None])[0]
    alpha = (rotation_y - np.arctan2(x, z) + np.pi) % (2 * np.pi) - np.pi
    left, top, wide, high = box_xywh(label.mask)
    pixels = (left, top, left + wide - 1, top + high - 1)
    numbers = [alpha, *pixels, height, width, length, x, y + height / 2, z, rotation_y, label.confidence]
    return " ".join(["_".join(label.category.split()) or "_", "-1", "-1", *(f"{one:.4f}" for one in numbers)]) + "\n"


def _calibration(projection: Float[np.ndarray, "3 4"], world_to_level: Float[np.ndarray, "4 4"]) -> str:
    rows = {
        **{f"P{number}": projection for number in range(4)},
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": world_to_level[:3],
        "Tr_imu_to_velo": np.eye(4)[:3],
    }
    return "".join(
        f"{name}: {' '.join(f'{value:.12e}' for value in matrix.ravel())}\n" for name, matrix in rows.items()
    )
