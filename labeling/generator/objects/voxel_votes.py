"""Counting, for one view, how many pixels of each voxel lie inside and outside a mask."""

import numpy as np
from jaxtyping import Bool, Int32
from numba import njit


def split_voxels(
    voxels: Int32[np.ndarray, "h w"],
    foreground: Bool[np.ndarray, "h w"],
    background: Bool[np.ndarray, "h w"],
    hard_negatives: Bool[np.ndarray, "h w"],
    num_voxels: int,
) -> tuple[Int32[np.ndarray, "f"], Int32[np.ndarray, "b"], Int32[np.ndarray, "r"]]:
    """Voxels by what a mask says about most of their pixels in a view.

    Args:
        voxels: voxel of each pixel, -1 for none.
        foreground: pixels that certainly show the object.
        background: pixels that certainly do not; no pixel is both.
        hard_negatives: pixels whose voxels are asked for whatever the others say.
        num_voxels: size of the cloud.

    Returns:
        Voxels with more than half of their pixels in the foreground, those with more than half in the background, and
        those with any of the hard negatives; each rising.
    """
    side = foreground.astype(np.uint8) + 2 * background.view(np.uint8) + 4 * hard_negatives.view(np.uint8)
    return _split(np.ascontiguousarray(voxels).ravel(), side.ravel(), num_voxels)


@njit(cache=True, nogil=True)
def _split(voxels, side, num_voxels):  # pragma: no cover - compiled
    """The three lists of ``split_voxels``.

    Args:
        voxels: (pixels,) int32, -1 for none.
        side: (pixels,) uint8, a sum of 1 foreground, 2 background, 4 hard negative.
        num_voxels: size of the cloud.
    """
    balance_in, balance_out = np.zeros(num_voxels, np.int32), np.zeros(num_voxels, np.int32)
    near = np.zeros(num_voxels, np.uint8)
    for pixel in range(len(voxels)):
        voxel = voxels[pixel]
        if voxel >= 0:
            balance_in[voxel] += 1 if side[pixel] & 1 else -1
            balance_out[voxel] += 1 if side[pixel] & 2 else -1
            near[voxel] |= side[pixel] >> 2
    counts = np.zeros(3, np.int64)
    for voxel in range(num_voxels):
        counts[0] += balance_in[voxel] > 0
        counts[1] += balance_out[voxel] > 0
        counts[2] += near[voxel]
    inside, outside = np.empty(counts[0], np.int32), np.empty(counts[1], np.int32)
    hard = np.empty(counts[2], np.int32)
    f, b, r = 0, 0, 0
    for voxel in range(num_voxels):
        if balance_in[voxel] > 0:
            inside[f] = voxel
            f += 1
        if balance_out[voxel] > 0:
            outside[b] = voxel
            b += 1
        if near[voxel]:
            hard[r] = voxel
            r += 1
    return inside, outside, hard
