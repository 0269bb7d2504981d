"""Thin parts in masks: too narrow for the filter that fills masks, they are drawn pixel by pixel."""

import numpy as np
from jaxtyping import Float32, Int32, Int64
from numba import njit

from labeling.generator.segment.thin_parts import ThinParts


def draw_parts(
    shown: Int32[np.ndarray, "h w"],
    pixels: Int64[np.ndarray, "k"],
    windows: Int64[np.ndarray, "k 4"],
    parts: ThinParts,
    view: int,
    voxels: Int32[np.ndarray, "h w"],
    depth_m: Float32[np.ndarray, "h w"],
) -> Int64[np.ndarray, "k 4"]:
    """Draws the parts that a view shows where it shows no object.

    Args:
        shown: the object at each pixel, -1 for none; receives the parts.
        pixels: of each object; receives those of its parts, too.
        windows: of the objects (``ViewChances``).
        parts: of the objects.
        view: index of the view.
        voxels: the voxel that each pixel fell into, -1 for none.
        depth_m: of the view.

    Returns:
        The windows with the rows of the parts; for parts of objects that had none, whole rows.
    """
    windows = windows.copy()
    _draw(shown, pixels, windows, parts.owner, parts.top_m, parts.rows[view], voxels, depth_m)
    return windows


@njit(cache=True, nogil=True)
def _draw(shown, pixels, windows, owner, top_m, row, voxels, depth_m):  # pragma: no cover - compiled
    """Does the work of ``draw_parts``; ``owner`` (n,) int32, ``top_m`` (n,) float32 and ``row`` (4,) are the parts'."""
    height, width = shown.shape
    for y in range(height):
        for x in range(width):
            voxel = voxels[y, x]
            if voxel < 0 or owner[voxel] < 0 or shown[y, x] >= 0:
                continue
            if (row[0] * x + row[1] * y + row[2]) * depth_m[y, x] + row[3] <= top_m[voxel]:
                continue
            k = owner[voxel]
            shown[y, x] = k
            pixels[k] += 1
            if windows[k, 1] == 0:
                windows[k] = np.array([y, y + 1, 0, width])
            windows[k, 0], windows[k, 1] = min(windows[k, 0], y), max(windows[k, 1], y + 1)
