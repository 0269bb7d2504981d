"""Frustums: the points that a view shows within a 2-D box, in axes that turn with the box's direction.

Frustum frame: origin at the camera, +Z up as in the world, +X the horizontal direction in which the middle of the 2-D
box lies, +Y to its left. Gravity is known (the camera's pose is), so that a frustum turns about the vertical alone, and
boxes that stand upright in the world do so here. Source: Qi et al. 2018, 4.1 (there the camera itself is level).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32

from labeling.core.geometry import unproject
from labeling.core.types import Box3d
from labeling.core.views import Camera

MAX_RANGE_M = 50.0
"""Depth beyond this is not used. Source: field notes (published code of SbM)."""


@dataclass(frozen=True)
class Frustum:
    """Some of what one view shows within one 2-D box."""

    points: Float32[np.ndarray, "n 3"]
    """Frustum frame, metres."""
    pixels: Float32[np.ndarray, "n 2"]
    """Where they lie in the view: x and y."""
    eye_m: Float[np.ndarray, "3"]
    """The camera in the world."""
    azimuth_rad: float
    """From the world's +X to the frustum's."""

    def to_world(self, box: Box3d) -> Box3d:
        """A box of this frustum in the world."""
        turn = rotation_about_z(self.azimuth_rad)
        return Box3d(turn @ box.centre_m + self.eye_m, box.extent_m, turn @ box.rotation)

    def from_world(self, box: Box3d) -> Box3d:
        """A box of the world in this frustum."""
        turn = rotation_about_z(-self.azimuth_rad)
        return Box3d(turn @ (box.centre_m - self.eye_m), box.extent_m, turn @ box.rotation)


def make_frustum(
    depth_m: Float32[np.ndarray, "h w"],
    camera: Camera,
    box_xyxy: tuple[float, float, float, float],
    most: int,
    rng: np.random.Generator,
) -> Frustum:
    """Cuts a frustum out of a view.

    Args:
        depth_m: z-depth, 0 = no return.
        camera: of the view.
        box_xyxy: left, top, right, bottom in pixels; what lies outside of the view is cut off.
        most: points to keep, chosen evenly.
        rng: chooses.

    Raises:
        ValueError: if the box is empty or not finite.
    """
    left, top, right, bottom = check_box(box_xyxy)
    height, width = depth_m.shape
    columns = slice(*np.clip([np.floor(left), np.ceil(right)], 0, width).astype(int).tolist())
    rows = slice(*np.clip([np.floor(top), np.ceil(bottom)], 0, height).astype(int).tolist())
    window = depth_m[rows, columns]
    y, x = np.nonzero((window > 0) & (window <= MAX_RANGE_M))
    if len(y) > most:
        chosen = rng.choice(len(y), most, replace=False)
        y, x = y[chosen], x[chosen]
    pixels = np.stack([x + columns.start, y + rows.start], axis=1).astype(float)
    points = unproject(pixels, window[y, x].astype(float), camera.intrinsics, camera.camera_to_world)
    eye = np.asarray(camera.camera_to_world[:3, 3], float)
    azimuth = azimuth_of_pixel(box_centre(box_xyxy), horizontal_rays(camera))
    local = (points - eye) @ rotation_about_z(azimuth)
    return Frustum(local.astype(np.float32), pixels.astype(np.float32), eye, azimuth)


def crop_frustum(
    frustum: Frustum, box_xyxy: tuple[float, float, float, float], azimuth_rad: float
) -> tuple[Frustum, Bool[np.ndarray, "n"]]:
    """What another 2-D box leaves of a frustum, in the axes of that box.

    Args:
        frustum: of a box that contains the other one.
        box_xyxy: in pixels.
        azimuth_rad: of its middle (``azimuth_of_pixel``).

    Returns:
        The new frustum, and which points of the old one it keeps.
    """
    left, top, right, bottom = check_box(box_xyxy)
    x, y = frustum.pixels.T
    kept = (x >= left) & (x < right) & (y >= top) & (y < bottom)
    turned = frustum.points[kept] @ rotation_about_z(azimuth_rad - frustum.azimuth_rad).astype(np.float32)
    return Frustum(turned, frustum.pixels[kept], frustum.eye_m, azimuth_rad), kept


def box_centre(box_xyxy: tuple[float, float, float, float]) -> tuple[float, float]:
    """Pixel (x, y) in the middle of a box; centres of pixels have whole numbers, their edges lie between them."""
    return 0.5 * (box_xyxy[0] + box_xyxy[2]) - 0.5, 0.5 * (box_xyxy[1] + box_xyxy[3]) - 0.5


def horizontal_rays(camera: Camera) -> Float[np.ndarray, "2 3"]:
    """What turns a pixel (x, y, 1) into the horizontal part of its ray in the world."""
    return camera.camera_to_world[:2, :3] @ np.linalg.inv(camera.intrinsics)


def azimuth_of_pixel(pixel: tuple[float, float], rays: Float[np.ndarray, "2 3"]) -> float:
    """Horizontal direction of a pixel's ray in the world, radians from +X to +Y; 0 for a vertical ray."""
    across = rays @ np.array([*pixel, 1.0])
    return float(np.arctan2(across[1], across[0]))


def rotation_about_z(angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """The rotation about the vertical; points (n, 3) times it, from the left, are turned by minus the angle."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def check_box(box_xyxy: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """The same box.

    Raises:
        ValueError: if it is empty or not finite.
    """
    left, top, right, bottom = (float(side) for side in box_xyxy)
    if not (np.all(np.isfinite([left, top, right, bottom])) and left < right and top < bottom):
        raise ValueError(
            f"a 2-D box is left, top, right, bottom in pixels, with left < right, top < bottom; not {box_xyxy}"
        )
    return left, top, right, bottom
