"""Lines of sight: which points lie in a picture, and what stands before them."""

import numba
import numpy as np
from jaxtyping import Float, Int

from labeling.core.geometry import project
from labeling.core.views import Camera


def pixels_in_view(
    points_m: Float[np.ndarray, "n 3"], camera: Camera, min_depth_m: float = 0.05, max_depth_m: float = np.inf
) -> tuple[Int[np.ndarray, "k"], tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]], Float[np.ndarray, "k"]]:
    """Where points lie in a picture, hidden or not.

    Args:
        points_m: world points.
        camera: whose picture it is.
        min_depth_m: nearer ones are left out.
        max_depth_m: so are farther ones.

    Returns:
        Numbers of those that lie in the picture, row and column of each one's pixel, and its z-depth.
    """
    height_px, width_px = camera.size
    pixels, depth_m = project(points_m, camera.intrinsics, camera.camera_to_world)
    inside = (depth_m > min_depth_m) & (depth_m < max_depth_m)
    x, y = np.rint(np.where(inside[:, None], np.clip(pixels, -1.0, (width_px, height_px)), -1.0)).astype(np.int64).T
    inside &= (x >= 0) & (x < width_px) & (y >= 0) & (y < height_px)
    return np.flatnonzero(inside), (y[inside], x[inside]), depth_m[inside]


@numba.njit(cache=True)
def unhidden(filled, origin_m, cell_m: float, eyes_m, target_m, stop_short_m: float, clear_m: float):
    """From which eyes no filled cell stands before a target. Every half cell on the way is looked at.

    Args:
        filled: grid of cells along X, Y and Z; what lies beyond it is empty.
        origin_m: its lower corner.
        cell_m: edge length of a cell.
        eyes_m: n x 3.
        target_m: what to look at.
        stop_short_m: so near to the target nothing counts.
        clear_m: nor so near to the eye.

    Returns:
        One flag for each eye.
    """
    free = np.ones(len(eyes_m), np.bool_)
    for number in range(len(eyes_m)):
        dx, dy, dz = eyes_m[number] - target_m
        distance_m = np.sqrt(dx * dx + dy * dy + dz * dz)
        sample = 0
        while True:
            along_m = stop_short_m + sample * 0.5 * cell_m
            if along_m >= distance_m - clear_m:
                break
            share = along_m / distance_m
            i = int(np.floor((target_m[0] + share * dx - origin_m[0]) / cell_m))
            j = int(np.floor((target_m[1] + share * dy - origin_m[1]) / cell_m))
            k = int(np.floor((target_m[2] + share * dz - origin_m[2]) / cell_m))
            within = 0 <= i < filled.shape[0] and 0 <= j < filled.shape[1] and 0 <= k < filled.shape[2]
            if within and filled[i, j, k]:
                free[number] = False
                break
            sample += 1
    return free
