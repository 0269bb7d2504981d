"""All views of an episode fused into one voxelised cloud in the world frame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8
from numba import njit, prange

_BITS = 21
_HALF = 1 << (_BITS - 1)


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

    @property
    def num_points(self) -> int:
        """How many occupied voxels there are."""
        return len(self.points)


def build_cloud(
    rgb: UInt8[np.ndarray, "views h w 3"],
    depth_m: Float32[np.ndarray, "views h w"],
    intrinsics: Float[np.ndarray, "views 3 3"],
    camera_to_world: Float[np.ndarray, "views 4 4"],
    voxel_m: float,
    max_range_m: float = np.inf,
    max_voxels: int = 2_000_000,
) -> Cloud:
    """Unprojects every pixel with depth into the world and averages colour and position per voxel.

    Args:
        rgb: colour.
        depth_m: z-depth, 0 where there is no return.
        intrinsics: K of each view.
        camera_to_world: pose of each view.
        voxel_m: edge of a voxel; doubled as often as needed to stay within ``max_voxels``.
        max_range_m: depth beyond this counts as no return.
        max_voxels: bound on the size of the cloud.

    Returns:
        The cloud. Voxels are numbered in order of appearance, view by view and row by row.

    Source: thesis A.2.1 (2D-to-3D unprojection).
    """
    if not voxel_m > 0:
        raise ValueError(f"voxel_m must be positive, not {voxel_m}")
    depth_m = np.ascontiguousarray(depth_m, np.float32)
    origin = np.floor(camera_to_world[:, :3, 3].mean(axis=0) / voxel_m) * voxel_m
    poses = np.ascontiguousarray(camera_to_world, np.float64)
    cameras = np.ascontiguousarray(intrinsics, np.float64)
    keys = _voxel_keys(depth_m, cameras, poses, origin, float(voxel_m), float(max_range_m))
    capacity = 1 << max(16, int(keys.size // 8).bit_length())
    while True:
        if capacity > 4 * max_voxels and capacity > 1 << 16:
            return build_cloud(rgb, depth_m, intrinsics, camera_to_world, 2.0 * voxel_m, max_range_m, max_voxels)
        numbers, count = _number_voxels(keys, capacity)
        if count >= 0:
            break
        capacity *= 2
    if count > max_voxels:
        factor = np.sqrt(count / max_voxels) * 1.1
        return build_cloud(rgb, depth_m, intrinsics, camera_to_world, factor * voxel_m, max_range_m, max_voxels)
    sums, counts = _accumulate(numbers, count, np.ascontiguousarray(rgb), depth_m, cameras, poses)
    mean = sums / np.maximum(counts, 1)[:, None]
    return Cloud(
        points=mean[:, :3].astype(np.float32),
        colours=(mean[:, 3:] / 255.0).astype(np.float32),
        counts=counts,
        voxel_of_pixel=numbers,
        voxel_m=float(voxel_m),
    )


@njit(cache=True, inline="always")
def _world(x, y, z, camera, pose):  # pragma: no cover - compiled
    a, b = (x - camera[0, 2]) / camera[0, 0] * z, (y - camera[1, 2]) / camera[1, 1] * z
    return (
        pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * z + pose[0, 3],
        pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * z + pose[1, 3],
        pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * z + pose[2, 3],
    )


@njit(cache=True, parallel=True)
def _voxel_keys(depth_m, cameras, poses, origin, voxel_m, max_range_m):  # pragma: no cover - compiled
    """The packed voxel of each pixel; -1 without depth, beyond range, or beyond the 2^21 voxels a side can number."""
    views, height, width = depth_m.shape
    keys = np.empty((views, height, width), np.int64)
    for row in prange(views * height):
        view, y = row // height, row % height
        for x in range(width):
            z = depth_m[view, y, x]
            keys[view, y, x] = -1
            if not (z > 0.0 and z <= max_range_m):
                continue
            point = _world(x, y, z, cameras[view], poses[view])
            i = np.int64(np.floor((point[0] - origin[0]) / voxel_m)) + _HALF
            j = np.int64(np.floor((point[1] - origin[1]) / voxel_m)) + _HALF
            k = np.int64(np.floor((point[2] - origin[2]) / voxel_m)) + _HALF
            if min(i, j, k) >= 0 and max(i, j, k) < 2 * _HALF:
                keys[view, y, x] = (i << (2 * _BITS)) | (j << _BITS) | k
    return keys


@njit(cache=True)
def _number_voxels(keys, capacity):  # pragma: no cover - compiled
    """Numbers distinct keys in order of appearance; count -1 if the table got more than half full."""
    mask = capacity - 1
    table_key = np.full(capacity, -1, np.int64)
    table_id = np.empty(capacity, np.int32)
    numbers = np.empty(keys.shape, np.int32)
    flat_keys, flat_numbers = keys.ravel(), numbers.ravel()
    count, last_key, last_number = 0, np.int64(-1), np.int32(-1)
    for p in range(flat_keys.size):
        key = flat_keys[p]
        if key == last_key:
            flat_numbers[p] = last_number
            continue
        if key == -1:
            flat_numbers[p] = -1
            continue
        mixed = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
        slot = np.int64((mixed ^ (mixed >> np.uint64(29))) & np.uint64(mask))
        while table_key[slot] != -1 and table_key[slot] != key:
            slot = (slot + 1) & mask
        if table_key[slot] == -1:
            if 2 * count >= capacity:
                return numbers, -1
            table_key[slot] = key
            table_id[slot] = count
            count += 1
        last_key, last_number = key, table_id[slot]
        flat_numbers[p] = last_number
    return numbers, count


@njit(cache=True)
def _accumulate(numbers, count, rgb, depth_m, cameras, poses):  # pragma: no cover - compiled
    """Sums of position and colour per voxel."""
    views, height, width = numbers.shape
    sums = np.zeros((count, 6))
    counts = np.zeros(count, np.int32)
    for view in range(views):
        for y in range(height):
            for x in range(width):
                number = numbers[view, y, x]
                if number < 0:
                    continue
                point = _world(x, y, depth_m[view, y, x], cameras[view], poses[view])
                for axis in range(3):
                    sums[number, axis] += point[axis]
                    sums[number, 3 + axis] += rgb[view, y, x, axis]
                counts[number] += 1
    return sums, counts
