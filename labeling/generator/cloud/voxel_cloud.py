"""All views of an episode fused into one voxelised cloud in the world frame."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, Int64
from numba import njit

from labeling.core.views import RgbdViews

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
        inside = np.ones(self.num_points, np.bool_)
        for axis in range(3):
            along = self.points[:, axis]
            inside &= (along >= np.float32(low[axis])) & (along <= np.float32(high[axis]))
        return inside

    def voxels_of_view(self, view: int) -> tuple[Int32[np.ndarray, "s"], Int32[np.ndarray, "h w"]]:
        """The voxels that a view sees, rising, and which of these each pixel shows (-1 for none)."""
        known = self._visible.get(view)
        if known is None:
            known = _rank(self.voxel_of_pixel[view], self.num_points)
            if len(self._visible) >= _CACHED_VIEWS:
                self._visible.pop([*self._visible][0], None)  # noqa: RUF015 - a list, as other threads add entries
            self._visible[view] = known
        return known

    def parents_of(self, fine: "Cloud") -> Int32[np.ndarray, "m"]:
        """The voxel of this cloud that each point of a finer cloud of the same views lies in; -1 for none."""
        return _parents(fine.voxel_of_pixel.ravel(), self.voxel_of_pixel.ravel(), fine.num_points)


def build_cloud(views: RgbdViews, voxel_m: float, max_range_m: float = np.inf, max_voxels: int = 2_000_000) -> Cloud:
    """Unprojects every pixel with depth into the world and averages colour and position per voxel.

    Args:
        views: of one scene.
        voxel_m: edge of a voxel; doubled as often as needed to stay within ``max_voxels``.
        max_range_m: depth beyond this counts as no return.
        max_voxels: bound on the size of the cloud.

    Returns:
        The cloud. Voxels are numbered in order of appearance, view by view and row by row.

    Source: thesis A.2.1 (2D-to-3D unprojection).
    """
    if not voxel_m > 0:
        raise ValueError(f"voxel_m must be positive, not {voxel_m}")
    depth_m, rgb = np.ascontiguousarray(views.depth_m, np.float32), np.ascontiguousarray(views.rgb)
    origin = np.floor(views.camera_to_world[:, :3, 3].mean(axis=0) / voxel_m) * voxel_m
    poses = np.ascontiguousarray(views.camera_to_world, np.float64)
    cameras = np.ascontiguousarray(views.intrinsics, np.float64)
    table, count = _Table.of(1 << 16), 0
    numbers = np.empty(depth_m.shape, np.int32)
    for view in range(len(depth_m)):
        camera, pose = cameras[view], poses[view]
        keys = _voxel_keys(
            depth_m[view], camera, pose, origin.astype(float), float(voxel_m), float(max_range_m)
        ).ravel()
        flat, done = numbers[view].ravel(), 0
        while True:
            done, count = _number(keys, flat, done, count, table.key, table.id)
            if done == len(keys):
                break
            table = table.enlarged(count)
        if count > max_voxels:
            factor = float(np.sqrt(count / max_voxels * len(depth_m) / (view + 1))) * 1.1
            return build_cloud(views, factor * voxel_m, max_range_m, max_voxels)
        _accumulate(numbers[view], rgb[view], depth_m[view], camera, pose, table.sums)
    points, colours, counts = _means(table.sums[:count])
    return Cloud(points, colours, counts, numbers, float(voxel_m))


@dataclass(frozen=True)
class _Table:
    """Hash table from packed voxels to their numbers, and what is summed in each."""

    key: Int64[np.ndarray, "capacity"]
    """-1 in free slots."""
    id: Int32[np.ndarray, "capacity"]
    sums: Float64[np.ndarray, "half 7"]
    """Position, colour, pixels."""

    @classmethod
    def of(cls, capacity: int) -> "_Table":
        """An empty table with so many slots, a power of 2."""
        half = capacity // 2
        return cls(np.full(capacity, -1, np.int64), np.empty(capacity, np.int32), np.zeros((half, 7)))

    def enlarged(self, count: int) -> "_Table":
        """One of four times the size with the same content, ``count`` voxels."""
        larger = _Table.of(4 * len(self.key))
        _enter(larger.key, larger.id, self.key, self.id)
        larger.sums[:count] = self.sums[:count]
        return larger


@njit(cache=True, inline="always")
def _world(x, y, z, camera, pose):  # pragma: no cover - compiled
    """World point of pixel (x, y) at z-depth ``z``; ``camera`` is K (3, 3), ``pose`` (4, 4) camera to world."""
    a, b = (x - camera[0, 2]) / camera[0, 0] * z, (y - camera[1, 2]) / camera[1, 1] * z
    return (
        pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * z + pose[0, 3],
        pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * z + pose[1, 3],
        pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * z + pose[2, 3],
    )


@njit(cache=True, nogil=True)
def _voxel_keys(depth_m, camera, pose, origin, voxel_m, max_range_m):  # pragma: no cover - compiled
    """The packed voxel of each pixel, (h, w) int64; -1 without depth, beyond range, or beyond 2^21 voxels a side.

    ``depth_m`` is (h, w) float32, ``camera`` K (3, 3), ``pose`` (4, 4) camera to world, ``origin`` (3,) the corner of
    voxel 0, metres.
    """
    height, width = depth_m.shape
    keys = np.empty((height, width), np.int64)
    for y in range(height):
        for x in range(width):
            z = depth_m[y, x]
            keys[y, x] = -1
            if not (z > 0.0 and z <= max_range_m):
                continue
            point = _world(x, y, z, camera, pose)
            i = np.int64(np.floor((point[0] - origin[0]) / voxel_m)) + _HALF
            j = np.int64(np.floor((point[1] - origin[1]) / voxel_m)) + _HALF
            k = np.int64(np.floor((point[2] - origin[2]) / voxel_m)) + _HALF
            if min(i, j, k) >= 0 and max(i, j, k) < 2 * _HALF:
                keys[y, x] = (i << (2 * _BITS)) | (j << _BITS) | k
    return keys


@njit(cache=True, inline="always")
def _slot(table_key, mask, key):  # pragma: no cover - compiled
    """The slot of a key in ``table_key`` (mask + 1,), or the free slot where it belongs. Fibonacci hashing."""
    mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    slot = np.int64((mixed ^ (mixed >> np.uint64(29))) & np.uint64(mask))
    while table_key[slot] != -1 and table_key[slot] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def _enter(table_key, table_id, old_key, old_id):  # pragma: no cover - compiled
    """Enters the keys and ids of an old table, -1 in its free slots, into a larger one, in place."""
    for old in range(len(old_key)):
        if old_key[old] != -1:
            slot = _slot(table_key, len(table_key) - 1, old_key[old])
            table_key[slot], table_id[slot] = old_key[old], old_id[old]


@njit(cache=True, nogil=True)
def _number(keys, numbers, done, count, table_key, table_id):  # pragma: no cover - compiled
    """Numbers distinct keys in order of appearance, from pixel ``done`` on, until the table is half full.

    ``keys`` and ``numbers`` are (pixels,), the latter filled in place; ``count`` voxels are known so far. One thread
    does it: the table is the bottleneck. Returns the first pixel left over and the number of voxels.
    """
    mask = len(table_key) - 1
    last_key, last_number = np.int64(-1), np.int32(-1)
    for p in range(done, len(keys)):
        key = keys[p]
        if key != last_key:
            last_key, last_number = key, np.int32(-1)
            if key != -1:
                slot = _slot(table_key, mask, key)
                if table_key[slot] == -1:
                    if 2 * count > mask:
                        return p, count
                    table_key[slot] = key
                    table_id[slot] = count
                    count += 1
                last_number = table_id[slot]
        numbers[p] = last_number
    return len(keys), count


@njit(cache=True, nogil=True)
def _accumulate(numbers, rgb, depth_m, camera, pose, sums):  # pragma: no cover - compiled
    """Adds position, colour and number of the pixels of a view to ``sums`` (voxels, 7) of their voxels, in place.

    ``numbers`` is (h, w) int32, the voxel of each pixel; ``camera`` K (3, 3), ``pose`` (4, 4) camera to world.
    """
    height, width = numbers.shape
    for y in range(height):
        for x in range(width):
            number = numbers[y, x]
            if number < 0:
                continue
            point = _world(x, y, depth_m[y, x], camera, pose)
            for axis in range(3):
                sums[number, axis] += point[axis]
                sums[number, 3 + axis] += rgb[y, x, axis]
            sums[number, 6] += 1.0


@njit(cache=True, nogil=True)
def _means(sums):  # pragma: no cover - compiled
    """Mean position (n, 3), mean colour in [0, 1] (n, 3), and number of pixels (n,) of ``sums`` (n, 7)."""
    count = len(sums)
    points, colours = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    pixels = np.empty(count, np.int32)
    for voxel in range(count):
        weight = sums[voxel, 6]
        for axis in range(3):
            points[voxel, axis] = sums[voxel, axis] / weight
            colours[voxel, axis] = sums[voxel, 3 + axis] / weight / 255.0
        pixels[voxel] = weight
    return points, colours, pixels


@njit(cache=True, nogil=True)
def _parents(fine, coarse, num_fine):  # pragma: no cover - compiled
    """The coarse voxel of each fine one, (num_fine,); ``fine`` and ``coarse`` are those of each pixel, (pixels,)."""
    parents = np.full(num_fine, -1, np.int32)
    for pixel in range(len(fine)):
        if fine[pixel] >= 0:
            parents[fine[pixel]] = coarse[pixel]
    return parents


@njit(cache=True, nogil=True)
def _rank(voxels, num_voxels):  # pragma: no cover - compiled
    """The distinct voxels (s,) of ``voxels`` (h, w), rising, and the place of each pixel's voxel among them (h, w)."""
    height, width = voxels.shape
    place = np.full(num_voxels, -1, np.int32)
    for y in range(height):
        for x in range(width):
            if voxels[y, x] >= 0:
                place[voxels[y, x]] = 0
    count = 0
    for voxel in range(num_voxels):
        if place[voxel] == 0:
            place[voxel] = count
            count += 1
    seen = np.empty(count, np.int32)
    for voxel in range(num_voxels):
        if place[voxel] >= 0:
            seen[place[voxel]] = voxel
    ranks = np.full((height, width), np.int32(-1))
    for y in range(height):
        for x in range(width):
            if voxels[y, x] >= 0:
                ranks[y, x] = place[voxels[y, x]]
    return seen, ranks
