"""Drawing thin parts into masks pixel by pixel, since they are too narrow for the edge-aware filter."""

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
    """Draws thin parts into the pixels of a view that show no object yet.

    Args:
        shown: index of the object at each pixel, -1 for none; parts are written into it.
        pixels: number of pixels of each object; those of its parts are added.
        windows: first row, one past the last, first column, one past the last of each object (``ViewChances``).
        parts: thin parts of these objects.
        view: index of the view.
        voxels: the voxel that each pixel fell into, -1 for none.
        depth_m: z-depth of the view, metres.

    Returns:
        Windows that also hold the rows of the parts; an object without a window gets one as wide as the picture.
    """
    windows = windows.copy()
    _draw(shown, pixels, windows, parts.owner, parts.top_m, parts.rows[view], voxels, depth_m)
    return windows


@njit(cache=True, nogil=True)
def _draw(shown, pixels, windows, owner, top_m, row, voxels, depth_m):  # pragma: no cover - compiled
    """Draws the parts in place.

    Args:
        shown: (h, w) int32, as in ``draw_parts``; written.
        pixels: (k,) int64, likewise; written.
        windows: (k, 4) int64, likewise; written.
        owner: (n,) int32, of ``ThinParts``.
        top_m: (n,) float32, likewise.
        row: (4,) float64, the view's of ``ThinParts.rows``.
        voxels: (h, w) int32, -1 for none.
        depth_m: (h, w) float32.
    """
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
