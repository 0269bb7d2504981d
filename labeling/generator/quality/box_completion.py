"""Boxes of whole objects from boxes of their visible parts: extended down to the surface that supports them."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32
from numba import njit

from labeling.core.types import Box3d

MAX_GAP, MAX_GAP_OF_SIDE, MAX_GAP_OF_FLAT = 0.5, 1.0, 1.5
"""Of an object's height, of its shorter horizontal side, and of that side where it is flat: if it is further above the
ground than these, it does not stand on it; it lies or hangs. What is flat stands on legs, which are lost first: the top
of a desk, which is higher than deep."""
FLAT = 0.5
"""Height, of its shorter horizontal side, up to which an object is flat."""
COVERED = 0.3
"""Share of the footprint that points at one height must cover to be a surface that an object stands on."""


def extend_to_support(
    box: Box3d,
    points: Float32[np.ndarray, "n 3"],
    own: Bool[np.ndarray, "n"],
    voxel_m: float,
    floor_m: float,
) -> Box3d:
    """Lets a box reach down to what its object stands on.

    Legs and the lower edge are what masks and depth lose first. The box grows to the highest surface below it, or
    failing that to the floor, if that is nearer than half of the object's height or than the object is deep, once and a
    half as deep if it is flat: a picture on a wall stays there.

    Args:
        box: upright; its third axis points up.
        points: the cloud of the episode.
        own: which points are the object's.
        voxel_m: spacing of the points.
        floor_m: height of the floor.
    """
    bottom, top = box.centre_m[2] - 0.5 * box.extent_m[2], box.centre_m[2] + 0.5 * box.extent_m[2]
    height_m, shorter_m = top - bottom, float(np.min(box.extent_m[:2]))
    most = MAX_GAP_OF_FLAT if height_m <= FLAT * shorter_m else MAX_GAP_OF_SIDE
    reach_m = max(MAX_GAP * height_m, most * shorter_m)
    lowest, highest = bottom - reach_m - voxel_m, bottom + 0.5 * voxel_m
    under = _under(points, own, box.centre_m, box.rotation, 0.5 * box.extent_m[:2], lowest, highest)
    local = (points[under].astype(float) - box.centre_m) @ box.rotation
    support = _highest_surface(local, box.extent_m[:2], voxel_m)
    ground = floor_m if support is None else box.centre_m[2] + support
    if not -voxel_m < bottom - ground < reach_m:
        return box
    return replace(
        box,
        centre_m=np.array([*box.centre_m[:2], 0.5 * (ground + top)]),
        extent_m=np.array([*box.extent_m[:2], top - ground]),
    )


@njit(cache=True, nogil=True)
def _under(points, own, centre, rotation, half, lowest, highest):  # pragma: no cover - compiled
    """Which points lie below an object.

    Args:
        points: (n, 3) float32.
        own: (n,) bool, those of the object, which do not count.
        centre: (3,) float64, of its box.
        rotation: (3, 3) float64, of its box, whose third axis points up.
        half: (2,) float64, half of its horizontal sides.
        lowest: of their heights.
        highest: likewise.

    Returns:
        (u,) int64.
    """
    found, count = np.empty(len(points), np.int64), 0
    for p in range(len(points)):
        z = np.float64(points[p, 2])
        if own[p] or z >= highest or z <= lowest:
            continue
        x, y, z = points[p, 0] - centre[0], points[p, 1] - centre[1], z - centre[2]
        along = x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0]
        across = x * rotation[0, 1] + y * rotation[1, 1] + z * rotation[2, 1]
        if abs(along) <= half[0] and abs(across) <= half[1]:
            found[count] = p
            count += 1
    return found[:count].copy()


def _highest_surface(local, sides, voxel_m: float) -> float | None:
    """Height of the highest layer of points that covers enough of the footprint; None if there is none."""
    if len(local) == 0:
        return None
    cell_m = 2.0 * voxel_m
    across = np.floor(local[:, :2] / cell_m).astype(int)
    layer = np.floor(local[:, 2] / cell_m).astype(int)
    needed = COVERED * max(1.0, float(np.prod(sides)) / cell_m**2)
    for height in np.unique(layer)[::-1]:
        here = layer == height
        if len(np.unique(across[here], axis=0)) >= needed:
            return float(np.median(local[here, 2]))
    return None
