"""Free-space evidence: where one view looks through a point that another one measured, nothing stands."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32
from numba import njit, prange

from labeling.core.geometry import invert_rigid
from labeling.core.views import RgbdViews
from labeling.generator.cloud.voxel_cloud import Cloud

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
    hits = _count_hits(cloud.voxel_of_pixel, cloud.num_points)
    misses = _count_misses(
        cloud.points,
        np.stack([_least_around(depth) for depth in views.depth_m]),
        np.ascontiguousarray(views.intrinsics, np.float64),
        np.stack([invert_rigid(pose) for pose in views.camera_to_world]),
        np.float64(np.sqrt(3.0) * cloud.voxel_m),
        MARGIN_SHARE,
    )
    return (misses >= MIN_MISSES) & (misses >= MISSES_PER_HIT * hits)


def clear_free_space(cloud: Cloud, views: RgbdViews) -> RgbdViews:
    """The views without the depth that lies in free space; the same ones if hardly any does.

    Args:
        cloud: made from these views.
        views: the views.
    """
    free = free_space_points(cloud, views)
    in_free_space = (cloud.voxel_of_pixel >= 0) & free[np.maximum(cloud.voxel_of_pixel, 0)]
    if np.count_nonzero(in_free_space) < NEGLIGIBLE * in_free_space.size:
        return views
    return replace(views, depth_m=np.where(in_free_space, np.float32(0), views.depth_m))


def _least_around(depth_m: Float32[np.ndarray, "h w"]) -> Float32[np.ndarray, "h w"]:
    """Least depth among the 3x3 pixels with a return around each pixel with a return; 0 without one."""
    import cv2

    known = depth_m > 0
    least = cv2.erode(np.where(known, depth_m, np.float32(np.inf)), np.ones((3, 3), np.uint8))
    return np.where(known, least, np.float32(0))


@njit(cache=True)
def _count_hits(voxel_of_pixel, count):  # pragma: no cover - compiled
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


@njit(cache=True, parallel=True)
def _count_misses(points, nearest, intrinsics, world_to_camera, margin_m, share):  # pragma: no cover - compiled
    """Number of views that look through each point.

    Args:
        points: (n, 3) float32, world, metres.
        nearest: (views, h, w) float32, least depth around each pixel, metres; 0 without one.
        intrinsics: (views, 3, 3) float64, K.
        world_to_camera: (views, 4, 4) float64.
        margin_m: how much further a view must see than the point.
        share: more of the same, as a share of the point's depth.

    Returns:
        (n,) int32.
    """
    views, height, width = nearest.shape
    found = np.zeros(len(points), np.int32)
    for p in prange(len(points)):
        for view in range(views):
            m, k = world_to_camera[view], intrinsics[view]
            z = m[2, 0] * points[p, 0] + m[2, 1] * points[p, 1] + m[2, 2] * points[p, 2] + m[2, 3]
            if not z > margin_m:
                continue
            x = m[0, 0] * points[p, 0] + m[0, 1] * points[p, 1] + m[0, 2] * points[p, 2] + m[0, 3]
            y = m[1, 0] * points[p, 0] + m[1, 1] * points[p, 1] + m[1, 2] * points[p, 2] + m[1, 3]
            u = np.floor(k[0, 0] * x / z + k[0, 2] + 0.5)
            v = np.floor(k[1, 1] * y / z + k[1, 2] + 0.5)
            if 0.0 <= u < width and 0.0 <= v < height and nearest[view, int(v), int(u)] > (1.0 + share) * z + margin_m:
                found[p] += 1
    return found
