"""Pinhole cameras, rigid transforms, and moving points between pixels and the world.

Conventions (docs/conventions.md): world in metres, right-handed, +Z up; camera in OpenCV axes, +X right, +Y down,
+Z forward; ``intrinsics`` is K (3, 3) in pixels with pixel centres at integer coordinates; ``camera_to_world`` is
(4, 4); ``depth_m`` is z-depth in metres, 0 where there is no return.
"""

import numpy as np
from jaxtyping import Float, Int

OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""Turns OpenGL camera axes (+Y up, -Z forward: MuJoCo, nerfstudio) into OpenCV ones and back: it is its own inverse."""


def intrinsics_matrix(fx: float, fy: float, cx: float, cy: float) -> Float[np.ndarray, "3 3"]:
    """K of focal lengths and principal point, pixels."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def intrinsics_from_fov(width_px: int, height_px: int, fov_x_rad: float) -> Float[np.ndarray, "3 3"]:
    """Intrinsics of an ideal camera with square pixels and the principal point in the middle of the picture.

    Args:
        width_px: picture width.
        height_px: picture height.
        fov_x_rad: horizontal field of view, from the left edge of the first pixel to the right edge of the last.

    Returns:
        K, in pixels.
    """
    focal_px = 0.5 * width_px / np.tan(0.5 * fov_x_rad)
    return intrinsics_matrix(focal_px, focal_px, 0.5 * (width_px - 1), 0.5 * (height_px - 1))


def flip_camera_axes(camera_to_world: Float[np.ndarray, "*views 4 4"]) -> Float[np.ndarray, "*views 4 4"]:
    """Converts ``camera_to_world`` between OpenGL and OpenCV camera axes (the same operation both ways).

    Used once, at the border: when reading or writing nerfstudio files and when asking MuJoCo for a camera.
    """
    return camera_to_world @ OPENGL_TO_OPENCV


def is_rigid(transform: Float[np.ndarray, "4 4"], tolerance: float = 1e-3) -> bool:
    """Whether a 4x4 matrix is a rotation plus a translation: finite, orthonormal, right-handed, last row 0 0 0 1."""
    if not np.all(np.isfinite(transform)):
        return False
    last_row = np.allclose(transform[3], [0.0, 0.0, 0.0, 1.0], atol=tolerance)
    return bool(last_row) and is_rotation(transform[:3, :3], tolerance)


def is_rotation(matrix: Float[np.ndarray, "3 3"], tolerance: float = 1e-3) -> bool:
    """Whether a 3x3 matrix is a rotation: finite, orthonormal, right-handed."""
    if not np.all(np.isfinite(matrix)) or np.abs(matrix).max() > 2.0:  # keeps the products below finite
        return False
    return bool(np.allclose(matrix @ matrix.T, np.eye(3), atol=tolerance) and np.linalg.det(matrix) > 0)


def invert_rigid(transform: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """Inverse of a rigid transform, without a general matrix inversion."""
    inverse = np.eye(4)
    inverse[:3, :3] = transform[:3, :3].T
    inverse[:3, 3] = -transform[:3, :3].T @ transform[:3, 3]
    return inverse


def transform_points(transform: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Applies a 4x4 transform to points; the result has the points' dtype."""
    rotation = transform[:3, :3].astype(points.dtype)
    return points @ rotation.T + transform[:3, 3].astype(points.dtype)


def look_at(eye: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Pose of an upright camera at ``eye`` that has ``target`` in the middle of its picture.

    Returns:
        ``camera_to_world`` (OpenCV axes).

    Raises:
        ValueError: if the target is at the eye, or straight above or below it (the heading is then undefined).
    """
    forward = np.asarray(target, float) - np.asarray(eye, float)
    distance = np.linalg.norm(forward)
    if distance < 1e-9:
        raise ValueError(f"look_at needs a target away from the eye; both are at {np.asarray(eye).tolist()}")
    forward = forward / distance
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9:
        raise ValueError("look_at cannot look straight up or down: the heading is undefined there")
    right /= np.linalg.norm(right)
    camera_to_world = np.eye(4)
    camera_to_world[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    camera_to_world[:3, 3] = eye
    return camera_to_world


def unproject(
    pixels: Float[np.ndarray, "n 2"],
    depth_m: Float[np.ndarray, "n"],
    intrinsics: Float[np.ndarray, "3 3"],
    camera_to_world: Float[np.ndarray, "4 4"],
) -> Float[np.ndarray, "n 3"]:
    """World points seen at ``pixels`` (x, y) at the given z-depths. Source: thesis A.2.1."""
    rays = (pixels - intrinsics[:2, 2]) / np.diag(intrinsics)[:2]
    points = np.concatenate([rays * depth_m[:, None], depth_m[:, None]], axis=1)
    return transform_points(camera_to_world, points)


def unproject_depth(
    depth_m: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], camera_to_world: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """World points of all pixels of a depth image that have a return (depth > 0), row by row.

    Returns:
        The points, and for each the flat (row-major) index of its pixel.
    """
    flat = np.flatnonzero(depth_m.ravel() > 0)
    y, x = np.divmod(flat, depth_m.shape[1])
    pixels = np.stack([x, y], axis=1).astype(float)
    return unproject(pixels, depth_m.ravel()[flat].astype(float), intrinsics, camera_to_world), flat


def project(
    points: Float[np.ndarray, "n 3"], intrinsics: Float[np.ndarray, "3 3"], camera_to_world: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """Pixel coordinates (x, y) and z-depths of world points. Source: thesis equation A.1.

    Points with z-depth <= 0 are behind the camera: their pixel coordinates are NaN.
    """
    in_camera = transform_points(invert_rigid(camera_to_world), points)
    depth_m = in_camera[:, 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        pixels = in_camera[:, :2] / depth_m[:, None] * np.diag(intrinsics)[:2] + intrinsics[:2, 2]
    pixels[depth_m <= 0] = np.nan
    return pixels, depth_m
