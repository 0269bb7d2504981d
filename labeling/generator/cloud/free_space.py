"""Free space: points that other views look through, so that no surface can be there."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32
from numba import njit

from labeling.core.geometry import invert_rigid
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.runtime.threads import in_threads, num_threads

MIN_MISSES = 2
"""Views that must look through a point: one alone may be wrong itself."""
MISSES_PER_HIT = 3
"""Views that look through a point, for each view that measured it, from which on the point is no surface. Thin things
(a chair's leg, leaves) are looked past by many views, but measured by many as well."""
NEGLIGIBLE = 5e-4
"""Share of the pixels below which clearing them is not worth a second cloud."""
MARGIN_SHARE = 0.02
"""How much further than the point a view must see, as a share of its depth: sensors err more further away."""


def free_space_points(cloud: Cloud, views: RgbdViews) -> Bool[np.ndarray, "n"]:
    """Points that too many views look through: mixed pixels at edges, sensor noise, things that moved on.

    A view looks through a point (a miss, in the terms of occupancy maps) if all depths around the pixel where the point
    would lie are greater than the point's by more than a voxel's diagonal and ``MARGIN_SHARE``; so neither rounding nor
    a surface's slope makes a hole. A view that measured the point is a hit.

    Args:
        cloud: the points, with the views that measured each.
        views: those that the cloud was made from.
    """
    if views.num_views <= MIN_MISSES:
        return np.zeros(cloud.num_points, bool)
    hits = count_hits(cloud.voxel_of_pixel, cloud.num_points)
    # No more views can look through a point than there are.
    doubtful = np.flatnonzero(MISSES_PER_HIT * hits <= views.num_views)
    misses = count_misses(cloud, views, doubtful)
    free = np.zeros(cloud.num_points, bool)
    free[doubtful] = (misses >= MIN_MISSES) & (misses >= MISSES_PER_HIT * hits[doubtful])
    return free


def count_misses(cloud: Cloud, views: RgbdViews, chosen: Int[np.ndarray, "d"]) -> Int32[np.ndarray, "d"]:
    """How many views look through each of some points, see ``free_space_points``.

    Args:
        cloud: the points.
        views: those that the cloud was made from.
        chosen: indices of points.
    """
    points = cloud.points[chosen]

    def misses_of(share: range) -> Int32[np.ndarray, "d"]:
        found = np.zeros(len(chosen), np.int32)
        for view in share:
            found += _looked_through(points, views, view, cloud.voxel_m)
        return found

    shares = [range(first, views.num_views, num_threads()) for first in range(num_threads())]
    return np.sum(in_threads(misses_of, shares), axis=0)


def looked_through(cloud: Cloud, views: RgbdViews, chosen: Int[np.ndarray, "d"], view: int) -> Bool[np.ndarray, "d"]:
    """Which of some points a view looks through, see ``free_space_points``.

    Args:
        cloud: the points.
        views: those that the cloud was made from.
        chosen: indices of points.
        view: index of the view.
    """
    return _looked_through(cloud.points[chosen], views, view, cloud.voxel_m)


def _looked_through(
    points: Float32[np.ndarray, "d 3"], views: RgbdViews, view: int, voxel_m: float
) -> Bool[np.ndarray, "d"]:
    camera, pose = np.ascontiguousarray(views.intrinsics[view], np.float64), invert_rigid(views.camera_to_world[view])
    return _through(points, views.depth_m[view], camera, pose, np.float64(np.sqrt(3.0) * voxel_m))


def clear_free_space(
    cloud: Cloud, views: RgbdViews, kept: Mapping[int, Bool[np.ndarray, "h w"]] | None = None
) -> RgbdViews:
    """The views without the depth that lies in free space; the same ones if hardly any does.

    Args:
        cloud: made from these views.
        views: the views.
        kept: pixels of views whose depth is kept in any case: they show what has moved on.
    """
    free = free_space_points(cloud, views)
    if cloud.counts[free].sum(dtype=np.int64) < NEGLIGIBLE * cloud.voxel_of_pixel.size:
        return views
    depth_m = views.depth_m.copy()
    for view, (depth, voxels) in enumerate(zip(depth_m, cloud.voxel_of_pixel, strict=True)):
        gone = (voxels >= 0) & free[np.maximum(voxels, 0)]
        if kept is not None and view in kept:
            gone &= ~kept[view]
        depth[gone] = 0
    return replace(views, depth_m=depth_m)


@njit(cache=True, nogil=True)
def count_hits(voxel_of_pixel, count):  # pragma: no cover - compiled
    """Number of views that measured each voxel.

    Args:
        voxel_of_pixel: (views, h, w) int32, -1 for none.
        count: n, number of voxels.

    Returns:
        (n,) int32.
    """
    views, height, width = voxel_of_pixel.shape
    hits = np.zeros(count, np.int32)
    last = np.full(count, -1, np.int32)
    for view in range(views):
        for y in range(height):
            for x in range(width):
                voxel = voxel_of_pixel[view, y, x]
                if voxel >= 0 and last[voxel] != view:
                    last[voxel] = view
                    hits[voxel] += 1
    return hits


@njit(cache=True, nogil=True)
def _through(points, depth_m, k, m, margin_m):  # pragma: no cover - compiled
    """The points that a view looks through.

    Args:
        points: (n, 3) float32, world, metres.
        depth_m: (h, w) float32, of the view, 0 without return.
        k: (3, 3) float64, K of the view.
        m: (4, 4) float64, world to camera.
        margin_m: how much further than the point the view must see, besides ``MARGIN_SHARE``.

    Returns:
        (n,) bool.
    """
    height, width = depth_m.shape
    found = np.zeros(len(points), np.bool_)
    for p in range(len(points)):
        z = m[2, 0] * points[p, 0] + m[2, 1] * points[p, 1] + m[2, 2] * points[p, 2] + m[2, 3]
        if not z > margin_m:
            continue
        x = m[0, 0] * points[p, 0] + m[0, 1] * points[p, 1] + m[0, 2] * points[p, 2] + m[0, 3]
        y = m[1, 0] * points[p, 0] + m[1, 1] * points[p, 1] + m[1, 2] * points[p, 2] + m[1, 3]
        u, v = np.floor(k[0, 0] * x / z + k[0, 2] + 0.5), np.floor(k[1, 1] * y / z + k[1, 2] + 0.5)
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        column, row = int(u), int(v)
        needed = (1.0 + MARGIN_SHARE) * z + margin_m
        through = depth_m[row, column] > needed
        if through:
            for near_row in range(max(0, row - 1), min(height, row + 2)):
                for near_column in range(max(0, column - 1), min(width, column + 2)):
                    near_m = depth_m[near_row, near_column]
                    through &= not (near_m > 0 and near_m <= needed)
        found[p] = through
    return found
