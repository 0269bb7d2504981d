"""All views of an episode fused into one voxelised cloud in the world frame."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, Int64
from numba import njit

from labeling.core.splatting import splat
from labeling.core.views import Camera, RgbdViews

GROWTH = 1.15
"""By which voxels grow that are too many: a surface has a quarter fewer of them then."""
_BITS = 21
_HALF = 1 << (_BITS - 1)
_CACHED_VIEWS = 16
"""Views whose visible voxels are kept in memory."""


@dataclass(frozen=True)
class Cloud:
    """One point per occupied voxel: the mean of the pixels that fell into it."""

    points: Float32[np.ndarray, "n 3"]
    """Metres, world."""
    colours: Float32[np.ndarray, "n 3"]
    """In [0, 1]."""
    counts: Int32[np.ndarray, "n"]
    """Pixels per voxel."""
    voxel_of_pixel: Int32[np.ndarray, "views h w"]
    """The voxel that each pixel fell into; -1 for pixels without (usable) depth."""
    voxel_m: float
    """Edge of a voxel."""
    _visible: dict[int, Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    @property
    def num_points(self) -> int:
        """How many occupied voxels there are."""
        return len(self.points)

    def within(self, low: Float[np.ndarray, "3"], high: Float[np.ndarray, "3"]) -> Bool[np.ndarray, "n"]:
        """Which points lie in an upright box, its faces included; metres, world."""
        return _within(self.points, np.asarray(low, np.float32), np.asarray(high, np.float32))

    def voxels_of_view(
        self, view: int
    ) -> tuple[Int32[np.ndarray, "s"], Int32[np.ndarray, "h w"], Int32[np.ndarray, "s"]]:
        """The voxels that a view sees, rising; which of these each pixel shows, -1 for none; and how many show each."""
        known = self._visible.get(view)
        if known is None:
            known = _rank(self.voxel_of_pixel[view], self.num_points)
            if len(self._visible) >= _CACHED_VIEWS:
                self._visible.pop([*self._visible][0], None)  # noqa: RUF015 - a list, as other threads add entries
            self._visible[view] = known
        return known


def voxels_of_blind_view(cloud: Cloud, view: int, camera: Camera):
    """What ``Cloud.voxels_of_view`` returns, where pixels without depth show the nearest voxel of any view."""
    own = cloud.voxel_of_pixel[view]
    return _rank(np.where(own >= 0, own, splat(cloud.points, camera, cloud.voxel_m)), cloud.num_points)


def build_cloud(views: RgbdViews, voxel_m: float, max_range_m: float = np.inf, max_voxels: int = 2_000_000) -> Cloud:
    """Unprojects every pixel with depth into the world and averages colour and position per voxel.

    Args:
        views: of one scene.
        voxel_m: edge of a voxel; grows by ``GROWTH`` as often as needed to stay within ``max_voxels``.
        max_range_m: depth beyond this counts as no return.
        max_voxels: bound on the size of the cloud.

    Returns:
        The cloud. Voxels are numbered in order of appearance, view by view and row by row.

    Source: thesis A.2.1 (2D-to-3D unprojection).
    """
    if not voxel_m > 0:
        raise ValueError(f"voxel_m must be positive, not {voxel_m}")
    depth_m, rgb = np.ascontiguousarray(views.depth_m, np.float32), np.ascontiguousarray(views.rgb)
    cells = Cells.of(views, voxel_m)
    table, count = CellTable.of(1 << 16), 0
    numbers = np.empty(views.depth_m.shape, np.int32)
    for view in range(views.num_views):
        pixels = depth_m[view], rgb[view], cells.rays[view], cells.eye[view], np.float32(max_range_m), numbers[view]
        row = 0
        while True:
            row, count = _fuse(*pixels, row, count, table.key, table.number, table.cell, table.sums)
            if row == depth_m.shape[1]:
                break
            table = table.enlarged(count)
        if count > max_voxels:  # how many more the other views would add nobody knows: they may show the same again
            return build_cloud(views, GROWTH * voxel_m, max_range_m, max_voxels)
    fused = means(table.cell[:count], table.sums[:count], cells.corner_m, float(voxel_m))
    return Cloud(*fused, numbers, float(voxel_m))


@dataclass(frozen=True)
class Cells:
    """The grid of cells that pixels fall into, counted from a corner far out, so that all counts are positive."""

    rays: Float64[np.ndarray, "views 3 3"]
    """For each view the direction of pixel (x, y) in cells: ``rays @ (x, y, 1)``, at a z-depth of 1 m."""
    eye: Float64[np.ndarray, "views 3"]
    """Where each camera stands, in cells."""
    corner_m: Float64[np.ndarray, "3"]
    """The corner of cell (0, 0, 0), world."""

    @classmethod
    def of(cls, views: RgbdViews, edge_m: float) -> "Cells":
        """Cells of this edge; one of their corners is at the world's origin."""
        poses = np.asarray(views.camera_to_world, np.float64)
        to_pixel = np.asarray(views.intrinsics, np.float64)
        rays = np.zeros((views.num_views, 3, 3))
        for axis in (0, 1):
            rays[:, :, axis] = poses[:, :3, axis] / to_pixel[:, None, axis, axis]
        rays[:, :, 2] = poses[:, :3, 2] - sum(rays[:, :, axis] * to_pixel[:, None, axis, 2] for axis in (0, 1))
        corner = np.floor(poses[:, :3, 3].mean(axis=0) / edge_m) - _HALF
        return cls(rays / edge_m, poses[:, :3, 3] / edge_m - corner, corner * edge_m)


@dataclass(frozen=True)
class CellTable:
    """Hash table from packed cells to the numbers of their voxels, and what is summed in each voxel."""

    key: Int64[np.ndarray, "capacity"]
    """-1 in free slots."""
    number: Int32[np.ndarray, "capacity"]
    cell: Int64[np.ndarray, "half"]
    """The packed cell of each voxel."""
    sums: Float32[np.ndarray, "half 8"]
    """Position in the cell, colour, pixels; the last is not used, so that a voxel lies in one line of the cache."""

    @classmethod
    def of(cls, capacity: int) -> "CellTable":
        """An empty table with so many slots, a power of 2."""
        half = capacity // 2
        free, cell = np.full(capacity, -1, np.int64), np.empty(half, np.int64)
        return cls(free, np.empty(capacity, np.int32), cell, np.zeros((half, 8), np.float32))

    def enlarged(self, count: int) -> "CellTable":
        """One of four times the size with the same content, ``count`` voxels."""
        larger = CellTable.of(4 * len(self.key))
        larger.cell[:count], larger.sums[:count] = self.cell[:count], self.sums[:count]
        _enter(larger.key, larger.number, larger.cell[:count])
        return larger


@njit(cache=True, nogil=True)
def locate(depth_m, y, rays, eye, max_range_m, place, cell, key):  # pragma: no cover - compiled
    """The cells of a row of pixels. Written as plain loops, so that the compiler makes vector instructions of them.

    Args:
        depth_m: (w,) float32.
        y: which row.
        rays: (3, 3) float64, of ``Cells``.
        eye: (3,) float64, of ``Cells``.
        max_range_m: depth beyond this counts as none.
        place: (3, w) float32, receives where in its cell each pixel lies, in [0, 1].
        cell: (3, w) int32, receives the cells.
        key: (w,) int64, receives the packed cells; -1 without depth, beyond range, or beyond 2^21 cells a side.
    """
    for axis in range(3):
        step, start, origin = rays[axis, 0], rays[axis, 1] * y + rays[axis, 2], eye[axis]
        within, whole = place[axis], cell[axis]
        for x in range(len(depth_m)):
            along = (step * x + start) * depth_m[x] + origin
            low = np.floor(along)
            within[x] = np.float32(along - low)
            whole[x] = np.int32(low) if (low >= 0.0) & (low < 2.0 * _HALF) else np.int32(-1)
    for x in range(len(depth_m)):
        i, j, k, z = np.int64(cell[0, x]), np.int64(cell[1, x]), np.int64(cell[2, x]), depth_m[x]
        known = (z > 0) & (z <= max_range_m) & ((i | j | k) >> _BITS == 0)
        key[x] = (i << (2 * _BITS)) | (j << _BITS) | k if known else -1


@njit(cache=True, inline="always")
def slot_of(table_key, mask, key):  # pragma: no cover - compiled
    """The slot of a key in ``table_key`` (mask + 1,), or the free slot where it belongs. Fibonacci hashing."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = np.int64((mixed ^ (mixed >> np.uint64(29))) & np.uint64(mask))
    while table_key[slot] != -1 and table_key[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _enter(table_key, table_number, cells):  # pragma: no cover - compiled
    """Enters the distinct packed ``cells`` (n,), numbered in their order, into an empty table, in place."""
    for number in range(len(cells)):
        slot = slot_of(table_key, len(table_key) - 1, cells[number])
        table_key[slot], table_number[slot] = cells[number], number


@njit(cache=True, nogil=True)
def _fuse(depth_m, rgb, rays, eye, max_range_m, numbers, row, count, table_key, table_number, table_cell, sums):
    # pragma: no cover - compiled
    """Numbers the cells of a view's pixels in order of appearance and sums what they hold, until the table is full.

    Runs of pixels in one cell are summed before the table is asked, and it is asked only if the pixel above does not
    know the answer.

    Args:
        depth_m: (h, w) float32.
        rgb: (h, w, 3) uint8.
        rays: (3, 3) float64, of ``Cells``.
        eye: (3,) float64, of ``Cells``.
        max_range_m: depth beyond this counts as none.
        numbers: (h, w) int32, receives the voxel of each pixel, -1 for none.
        row: where to begin.
        count: voxels known so far.
        table_key: (capacity,) int64, of ``CellTable``, as the others; filled in place.
        table_number: (capacity,) int32.
        table_cell: (half,) int64.
        sums: (half, 8) float32.

    Returns:
        The first row left over, and the number of voxels.
    """
    height, width = depth_m.shape
    mask = len(table_key) - 1
    place, cell = np.empty((3, width), np.float32), np.empty((3, width), np.int32)
    key, above = np.empty(width, np.int64), np.full(width, -1, np.int64)
    for y in range(row, height):
        if 2 * (count + width) > mask:
            return y, count
        locate(depth_m[y], y, rays, eye, max_range_m, place, cell, key)
        x = 0
        while x < width:
            here = key[x]
            if here < 0:
                numbers[y, x] = -1
                x += 1
                continue
            first = x
            a, b, c = np.float32(0), np.float32(0), np.float32(0)
            red, green, blue = 0, 0, 0
            while x < width and key[x] == here:
                a += place[0, x]
                b += place[1, x]
                c += place[2, x]
                red += rgb[y, x, 0]
                green += rgb[y, x, 1]
                blue += rgb[y, x, 2]
                x += 1
            if above[first] == here:
                number = numbers[y - 1, first]
            elif above[x - 1] == here:
                number = numbers[y - 1, x - 1]
            else:
                slot = slot_of(table_key, mask, here)
                if table_key[slot] == -1:
                    table_key[slot], table_number[slot], table_cell[count] = here, count, here
                    count += 1
                number = table_number[slot]
            for same in range(first, x):
                numbers[y, same] = number
            total = sums[number]
            total[0] += a
            total[1] += b
            total[2] += c
            total[3] += red
            total[4] += green
            total[5] += blue
            total[6] += x - first
        key, above = above, key
    return height, count


@njit(cache=True, nogil=True)
def means(cells, sums, corner_m, edge_m):  # pragma: no cover - compiled
    """Mean position (n, 3), mean colour in [0, 1] (n, 3), and number of pixels (n,) of voxels.

    Args:
        cells: (n,) int64, packed.
        sums: (n, 8) float32, of ``CellTable``.
        corner_m: (3,) float64, of ``Cells``.
        edge_m: of a cell.
    """
    count = len(cells)
    points, colours = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    pixels = np.empty(count, np.int32)
    for voxel in range(count):
        weight = np.float64(sums[voxel, 6])
        for axis in range(3):
            cell = (cells[voxel] >> ((2 - axis) * _BITS)) & (2 * _HALF - 1)
            points[voxel, axis] = corner_m[axis] + (cell + sums[voxel, axis] / weight) * edge_m
            colours[voxel, axis] = sums[voxel, 3 + axis] / weight / 255.0
        pixels[voxel] = weight
    return points, colours, pixels


@njit(cache=True, nogil=True)
def _within(points, low, high):  # pragma: no cover - compiled
    """Which ``points`` (n, 3) lie between ``low`` (3,) and ``high`` (3,)."""
    inside = np.empty(len(points), np.bool_)
    for p in range(len(points)):
        inside[p] = (
            (points[p, 0] >= low[0])
            & (points[p, 0] <= high[0])
            & (points[p, 1] >= low[1])
            & (points[p, 1] <= high[1])
            & (points[p, 2] >= low[2])
            & (points[p, 2] <= high[2])
        )
    return inside


@njit(cache=True, nogil=True)
def _rank(voxels, num_voxels):  # pragma: no cover - compiled
    """The distinct voxels (s,) of ``voxels`` (h, w), rising; the place of each pixel's voxel among them (h, w), -1 for
    none; and the number of pixels of each (s,).
    """
    height, width = voxels.shape
    count = np.zeros(num_voxels, np.int32)
    for y in range(height):
        for x in range(width):
            if voxels[y, x] >= 0:
                count[voxels[y, x]] += 1
    seen, place = np.empty(min(height * width, num_voxels), np.int32), np.empty(num_voxels, np.int32)
    found = 0
    for voxel in range(num_voxels):
        if count[voxel] > 0:
            seen[found], place[voxel] = voxel, found
            found += 1
    ranks = np.empty((height, width), np.int32)
    for y in range(height):
        for x in range(width):
            ranks[y, x] = place[voxels[y, x]] if voxels[y, x] >= 0 else -1
    pixels = np.empty(found, np.int32)
    for rank in range(found):
        pixels[rank] = count[seen[rank]]
    return seen[:found].copy(), ranks, pixels
