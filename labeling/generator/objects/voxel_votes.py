"""Counting, for one view, how many pixels of each voxel lie inside and outside a mask."""

import numpy as np
from jaxtyping import Int32, UInt8
from numba import njit


def split_voxels(
    voxels: Int32[np.ndarray, "h w"], side: UInt8[np.ndarray, "h w"], pixels: Int32[np.ndarray, "n"]
) -> tuple[Int32[np.ndarray, "f"], Int32[np.ndarray, "b"], Int32[np.ndarray, "r"]]:
    """Voxels by what a mask says about most of their pixels in a view.

    Args:
        voxels: voxel of each pixel, -1 for none, in a window of the view; all pixels out of it are background.
        side: what the mask says of each pixel: a sum of 1 foreground, 2 background (no pixel is both), 4 hard
            negative, whose voxels are asked for whatever the others say.
        pixels: of each voxel in the whole view.

    Returns:
        Voxels with more than half of their pixels in the foreground, those with more than half in the background, and
        those with any of the hard negatives; each rising.
    """
    return _split(voxels, side, pixels)


@njit(cache=True, nogil=True)
def _split(voxels, side, pixels):  # pragma: no cover - compiled
    """The three lists of ``split_voxels``.

    Args:
        voxels: (h, w) int32, -1 for none.
        side: (h, w) uint8, a sum of 1 foreground, 2 background, 4 hard negative.
        pixels: (n,) int32, of each voxel in the whole view.
    """
    height, width = voxels.shape
    front, other, near = (
        np.zeros(len(pixels), np.int32),
        np.zeros(len(pixels), np.int32),
        np.zeros(len(pixels), np.uint8),
    )
    for y in range(height):
        for x in range(width):
            voxel, what = voxels[y, x], side[y, x]
            if voxel >= 0:
                front[voxel] += what & 1
                other[voxel] += 1 - ((what >> 1) & 1)
                near[voxel] |= what >> 2
    inside, outside = np.empty(len(pixels), np.int32), np.empty(len(pixels), np.int32)
    hard = np.empty(len(pixels), np.int32)
    f, b, r = 0, 0, 0
    for voxel in range(len(pixels)):
        inside[f] = outside[b] = hard[r] = voxel
        f += 2 * front[voxel] > pixels[voxel]
        b += 2 * other[voxel] < pixels[voxel]
        r += near[voxel]
    return inside[:f], outside[:b], hard[:r]
