"""Points of chosen voxels at about the resolution of the pictures, from which outlines are drawn."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32
from numba import njit

from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import Cells, CellTable, Cloud, locate, means, slot_of

MAX_POINTS = 3_000_000
"""Most points, to bound memory."""


@dataclass(frozen=True)
class FinePoints:
    """Means of pixels over cells smaller than voxels."""

    points: Float32[np.ndarray, "m 3"]
    """Mean positions, metres, world."""
    voxel: Int32[np.ndarray, "m"]
    """Index of the voxel that the last pixel of each cell fell into."""
    spacing_m: float
    """Edge of the cells, metres."""


def fine_points(
    views: RgbdViews, cloud: Cloud, chosen: Bool[np.ndarray, "n"], spacing_m: float, max_points: int = MAX_POINTS
) -> FinePoints:
    """Averages the pixels of some voxels over smaller cells.

    Args:
        views: those that the cloud was made from.
        cloud: the voxels.
        chosen: whether each voxel is to have fine points.
        spacing_m: edge of the cells; doubled as often as needed to stay within ``max_points``.
        max_points: bound on their number.

    Returns:
        The points, in order of appearance.
    """
    depth_m = np.ascontiguousarray(views.depth_m, np.float32)
    cells = Cells.of(views, spacing_m)
    table, count = CellTable.of(1 << 16), 0
    voxel = np.empty(len(table.cell), np.int32)
    # A cell can hold pixels of several voxels and belongs to that of the last one: so neighbours are visited as well.
    visited = _with_neighbours(cloud.voxel_of_pixel, chosen)
    for view in range(views.num_views):
        pixels = depth_m[view], cloud.voxel_of_pixel[view], visited, cells.rays[view], cells.eye[view]
        row = 0
        while True:
            row, count = _gather(*pixels, row, count, table.key, table.number, table.cell, table.sums, voxel)
            if row == depth_m.shape[1]:
                break
            table = table.enlarged(count)
            voxel = np.concatenate([voxel[:count], np.empty(len(table.cell) - count, np.int32)])
        if count > max_points:
            return fine_points(views, cloud, chosen, 2.0 * spacing_m, max_points)
    points, _, _ = means(table.cell[:count], table.sums[:count], cells.corner_m, float(spacing_m))
    kept = np.flatnonzero(chosen[voxel[:count]])
    return FinePoints(points[kept], voxel[kept], float(spacing_m))


@njit(cache=True, nogil=True)
def _with_neighbours(voxel_of_pixel, chosen):  # pragma: no cover - compiled
    """Chosen voxels (n,) and those that lie beside one in any view; ``voxel_of_pixel`` is (views, h, w)."""
    views, height, width = voxel_of_pixel.shape
    found = chosen.copy()
    for view in range(views):
        for y in range(height):
            for x in range(width):
                voxel = voxel_of_pixel[view, y, x]
                if voxel < 0:
                    continue
                if x + 1 < width:
                    right = voxel_of_pixel[view, y, x + 1]
                    if right >= 0 and chosen[right] != chosen[voxel]:
                        found[right] = found[voxel] = True
                if y + 1 < height:
                    below = voxel_of_pixel[view, y + 1, x]
                    if below >= 0 and chosen[below] != chosen[voxel]:
                        found[below] = found[voxel] = True
    return found


@njit(cache=True, nogil=True)
def _gather(
    depth_m, voxels, chosen, rays, eye, row, count, table_key, table_number, table_cell, sums, voxel_of_point
):  # pragma: no cover - compiled
    """Numbers the cells of the pixels of chosen voxels and sums their positions, until the table is full.

    Args:
        depth_m: (h, w) float32.
        voxels: (h, w) int32, voxel of each pixel, -1 for none.
        chosen: (n,) bool, of the voxels.
        rays: (3, 3) float64, of ``Cells``.
        eye: (3,) float64, of ``Cells``.
        row: where to begin.
        count: cells known so far.
        table_key: (capacity,) int64, of ``CellTable``, as the next three; filled in place.
        table_number: (capacity,) int32.
        table_cell: (half,) int64.
        sums: (half, 8) float32.
        voxel_of_point: (half,) int32, receives the voxel of the last pixel in each cell.

    Returns:
        The first row left over, and the number of cells.
    """
    height, width = depth_m.shape
    mask = len(table_key) - 1
    place, cell = np.empty((3, width), np.float32), np.empty((3, width), np.int32)
    key = np.empty(width, np.int64)
    # Key and number of the cell of each pixel in the row above.
    above, number_above = np.full(width, -1, np.int64), np.empty(width, np.int32)
    for y in range(row, height):
        if 2 * (count + width) > mask:
            return y, count
        first, last = width, -1
        for x in range(width):
            if voxels[y, x] >= 0 and chosen[voxels[y, x]]:
                first, last = min(first, x), x
        if last < 0:
            continue
        locate(depth_m[y], y, rays, eye, np.float32(np.inf), place, cell, key)
        last_key, number = np.int64(-1), np.int32(-1)
        above[:first], above[last + 1 :] = -1, -1
        for x in range(first, last + 1):
            if voxels[y, x] < 0 or not chosen[voxels[y, x]] or key[x] < 0:
                above[x] = -1
                continue
            if key[x] == above[x]:
                last_key, number = key[x], number_above[x]
            elif key[x] != last_key:
                last_key = key[x]
                slot = slot_of(table_key, mask, last_key)
                if table_key[slot] == -1:
                    table_key[slot], table_number[slot], table_cell[count] = last_key, count, last_key
                    count += 1
                number = table_number[slot]
            above[x], number_above[x] = last_key, number
            voxel_of_point[number] = voxels[y, x]
            sums[number, 0] += place[0, x]
            sums[number, 1] += place[1, x]
            sums[number, 2] += place[2, x]
            sums[number, 6] += np.float32(1)
    return height, count
