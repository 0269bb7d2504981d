"""Splatting: drawing clouds into views, the nearest point at each pixel, or whole objects each alone."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from numba import njit

from labeling.core.views import Camera


def splat(
    points: Float[np.ndarray, "n 3"], camera: Camera, point_size_m: float | Float[np.ndarray, "n"] = 0.0
) -> Int32[np.ndarray, "h w"]:
    """Draws a cloud into a view with a z-buffer.

    Args:
        points: world points, metres.
        camera: of the view.
        point_size_m: edge of the camera-facing square that each point covers (at least the pixel it falls into);
            points nearer to the camera than that are not drawn.

    Returns:
        For every pixel the index of the nearest point drawn there, -1 for none; of points at one depth (in single
        precision) the one with the lowest index.

    Source: thesis A.2.1 (3D-to-2D projection: only the point closest to the camera).
    """
    index = np.full(camera.size, -1, np.int32)
    depth = np.full(camera.size, np.inf, np.float32)
    sizes_m = np.full(len(points), point_size_m, np.float64)
    _paint_nearest(index, depth, points, *_matrices(camera), sizes_m)
    return index


def silhouettes(
    points: Float[np.ndarray, "n 3"],
    object_of_point: Int32[np.ndarray, "n"],
    num_objects: int,
    camera: Camera,
    point_size_m: float,
    rows: Bool[np.ndarray, "k h"] | None = None,
    before_m: Float32[np.ndarray, "h w"] | None = None,
) -> Bool[np.ndarray, "k h w"]:
    """Every object drawn alone into a view, as if nothing stood before it.

    Args:
        points: world points, metres.
        object_of_point: index of the object, -1 for none.
        num_objects: how many objects there are.
        camera: of the view.
        point_size_m: edge of the camera-facing square that a point covers (at least the pixel it falls into).
        rows: those that an object is drawn in are set.
        before_m: z-depth that the view has measured, 0 where there is no return. With it only those pixels are drawn
            at which a point is hidden, farther than this by its size or more, and those without a return: where the
            view looks at something at the point's depth or behind, that is what there is.

    Returns:
        One mask per object.
    """
    drawn = np.zeros((num_objects, *camera.size), np.bool_)
    rows = np.zeros(drawn.shape[:2], np.bool_) if rows is None else rows
    before_m = np.zeros(camera.size, np.float32) if before_m is None else np.ascontiguousarray(before_m, np.float32)
    _paint_all(drawn, rows, points, object_of_point, *_matrices(camera), point_size_m, before_m)
    return drawn


def _matrices(camera: Camera) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "4 4"]]:
    """K and the pose, world to camera, as the kernels want them."""
    return np.ascontiguousarray(camera.intrinsics, float), np.ascontiguousarray(camera.world_to_camera)


@njit(cache=True, inline="always")
def _place(point, to_camera):  # pragma: no cover - compiled
    """A world point (3,) in the frame of the camera, whose pose (4, 4) is world to camera."""
    x, y, z = float(point[0]), float(point[1]), float(point[2])
    return (
        to_camera[0, 0] * x + to_camera[0, 1] * y + to_camera[0, 2] * z + to_camera[0, 3],
        to_camera[1, 0] * x + to_camera[1, 1] * y + to_camera[1, 2] * z + to_camera[1, 3],
        to_camera[2, 0] * x + to_camera[2, 1] * y + to_camera[2, 2] * z + to_camera[2, 3],
    )


@njit(cache=True, inline="always")
def _square(point, camera, point_size_m, height, width):  # pragma: no cover - compiled
    """Pixels that a point covers: first and last column, first and last row; an empty range if it is out of view.

    Nearer than its own size a point would cover the whole picture; such points are noise at the lens.

    Args:
        point: x, y, z in the camera's frame, metres.
        camera: (3, 3) float64, K.
        point_size_m: edge of the camera-facing square.
        height: of the picture, pixels.
        width: of the picture, pixels.
    """
    z = point[2]
    if not z > point_size_m:
        return 0, -1, 0, -1
    x = camera[0, 0] * point[0] / z + camera[0, 2]
    y = camera[1, 1] * point[1] / z + camera[1, 2]
    half_x, half_y = 0.5 * point_size_m * camera[0, 0] / z, 0.5 * point_size_m * camera[1, 1] / z
    if not (-half_x - 0.5 < x < width - 0.5 + half_x and -half_y - 0.5 < y < height - 0.5 + half_y):
        return 0, -1, 0, -1
    left, right = int(np.ceil(x - half_x)), int(np.floor(x + half_x))
    top, bottom = int(np.ceil(y - half_y)), int(np.floor(y + half_y))
    if left > right:
        left = right = int(np.floor(x + 0.5))
    if top > bottom:
        top = bottom = int(np.floor(y + 0.5))
    return max(0, left), min(width - 1, right), max(0, top), min(height - 1, bottom)


@njit(cache=True, nogil=True)
def _paint_nearest(index, depth, points, camera, to_camera, sizes_m):  # pragma: no cover - compiled
    """Writes into ``index`` (h, w) int32 the nearest of the ``points`` (n, 3), and into ``depth`` (h, w) its z-depth.

    ``camera`` is K (3, 3), ``to_camera`` the pose (4, 4) world to camera, ``sizes_m`` (n,) the edges of the points;
    both pictures come with their background.
    """
    height, width = index.shape
    for p in range(len(points)):
        placed = _place(points[p], to_camera)
        left, right, top, bottom = _square(placed, camera, sizes_m[p], height, width)
        z = np.float32(placed[2])
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                if z < depth[v, u]:
                    depth[v, u] = z
                    index[v, u] = p


@njit(cache=True, nogil=True)
def _paint_all(drawn, rows, points, object_of_point, camera, to_camera, point_size_m, before_m):
    # pragma: no cover - compiled
    """Sets in ``drawn`` (k, h, w) bool the pixels of each object's ``points`` (n, 3), in ``rows`` (k, h) their rows.

    ``object_of_point`` is (n,) int32, -1 for none; ``camera`` is K (3, 3), ``to_camera`` the pose (4, 4) world to
    camera; ``before_m`` (h, w) float32 is the depth that points must be hidden by, 0 for no matter what.
    """
    _, height, width = drawn.shape
    for p in range(len(points)):
        owner = object_of_point[p]
        if owner < 0:
            continue
        placed = _place(points[p], to_camera)
        left, right, top, bottom = _square(placed, camera, point_size_m, height, width)
        farthest = np.float32(placed[2] - point_size_m)
        for v in range(top, bottom + 1):
            for u in range(left, right + 1):
                if not before_m[v, u] > farthest:  # 0 and NaN are not
                    drawn[owner, v, u] = True
                    rows[owner, v] = True
