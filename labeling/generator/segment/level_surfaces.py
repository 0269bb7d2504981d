"""Level surfaces of objects, such as table tops: what an object has the greater part of belongs to it as a whole.

Detectors leave out what lies far behind, or between things on a table, in view after view, so that votes count against
it. But a level surface above the ground ends where the object ends. Where more would be added than the object has, it
is flush with something else.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32, Int32
from numba import njit

from labeling.generator.cloud.ground import Ground
from labeling.generator.cloud.voxel_cloud import Cloud

STEP_VOXELS = 0.1
"""Largest difference in height of neighbouring points of a level surface, in voxels."""
DRIFT_VOXELS = 0.2
"""Largest difference in height of the points of a level surface from that where it was begun, in voxels."""
ABOVE_VOXELS = 2.0
"""Least height of a level surface above the ground, in voxels."""
MIN_COLUMNS = 16
"""Least number of points that an object has of a level surface."""
MIN_SHARE = 0.1
"""The same as a share of the columns of voxels in which it has points."""
MAX_GROWTH = 1.0
"""Largest number of points added to a level surface, as a share of those that the object has of it."""


def complete_level_surfaces(
    cloud: Cloud,
    owner: Int32[np.ndarray, "n"],
    num_objects: int,
    ground: Ground,
    beside: Mapping[int, Float32[np.ndarray, "n"]] | None = None,
) -> Int32[np.ndarray, "n"]:
    """Finds the points that objects lack of their level surfaces.

    Args:
        cloud: the points.
        owner: the object that each point belongs to, -1 for none, less for those that shall stay without.
        num_objects: how many objects there are.
        ground: of the same points.
        beside: of objects that a person has drawn, how many outlines more have each voxel beside than within them:
            these get none of what lies beside.

    Returns:
        The object that each point is added to, -1 for none; if several lack it, the first of them.
    """
    found = np.full(cloud.num_points, -1, np.int32)
    voxel_m = np.float32(cloud.voxel_m)
    lowest_m = ground.height_m + np.float32(ABOVE_VOXELS) * voxel_m
    high = np.flatnonzero((owner >= -1) & (cloud.points[:, 2] > lowest_m))
    points, owner = cloud.points[high], owner[high]
    for k in range(num_objects):
        own = points[owner == k]
        if len(own) < MIN_COLUMNS:
            continue
        low, top = own.min(axis=0), own.max(axis=0)
        # Further than a surface can grow: of one that goes on beyond, so much is seen that it is too large.
        reach = np.append(2 * (top - low)[:2] + 2 * voxel_m, voxel_m)
        members = _near(points, owner, k, low - reach, top + reach)
        cell = np.floor(points[members] / voxel_m).astype(np.int32)
        shape = np.ptp(cell[:, :2], axis=0) + 1
        missing = _missing(points[members, 2], cell - cell.min(axis=0), shape, owner[members] == k, voxel_m)
        added = high[members[missing]]
        if beside and k in beside:
            added = added[beside[k][added] <= 0]
        found[added[found[added] < 0]] = k
    return found


@njit(cache=True, nogil=True)
def _near(points, owner, k, low, high):  # pragma: no cover - compiled
    """Points of an object, and of none, in a box.

    Args:
        points: (n, 3) float32, world, metres.
        owner: (n,) int32, the object that each point belongs to, -1 for none.
        k: the object.
        low: (3,) float32, lower corner of the box.
        high: (3,) float32, upper corner.

    Returns:
        Their indices (m,) int64.
    """
    found, count = np.empty(len(points), np.int64), 0
    for p in range(len(points)):
        if not (low[0] <= points[p, 0] <= high[0] and low[1] <= points[p, 1] <= high[1]):
            continue
        if low[2] <= points[p, 2] <= high[2] and (owner[p] == k or owner[p] == -1):
            found[count] = p
            count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _missing(height, cell, shape, own, voxel):  # pragma: no cover - compiled
    """Which points an object lacks of its level surfaces.

    A surface begins at the highest point that the object has in a column and goes from point to point in neighbouring
    columns, but not beyond one that lies in a wall, with others right above or below it.

    Args:
        height: (m,) float32, of the points, metres.
        cell: (m, 3) int32, of the grid of voxels, from 0.
        shape: (2,) int32, numbers of columns.
        own: (m,) bool, which points are the object's; the others belong to none.
        voxel: edge of a voxel, metres.

    Returns:
        (m,) bool.
    """
    first, following = np.full((shape[0], shape[1]), -1, np.int64), np.empty(len(height), np.int64)
    highest, columns = np.full((shape[0], shape[1]), -1, np.int64), 0
    for p in range(len(height)):
        a, b = cell[p, 0], cell[p, 1]
        following[p], first[a, b] = first[a, b], p
        if own[p]:
            columns += highest[a, b] < 0
            if highest[a, b] < 0 or height[p] > height[highest[a, b]]:
                highest[a, b] = p
    added, seen = np.zeros(len(height), np.bool_), np.zeros(len(height), np.bool_)
    queue = np.empty(len(height), np.int64)
    for start in highest.ravel():
        if start < 0 or seen[start]:
            continue
        seen[start], queue[0] = True, start
        head, tail, mine = 0, 1, 1
        while head < tail:
            p = queue[head]
            head += 1
            q, in_wall = first[cell[p, 0], cell[p, 1]], False
            while q >= 0:
                in_wall |= abs(cell[q, 2] - cell[p, 2]) == 1
                q = following[q]
            if in_wall:
                continue
            for da, db in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                a, b = cell[p, 0] + da, cell[p, 1] + db
                if not (0 <= a < shape[0] and 0 <= b < shape[1]):
                    continue
                q = first[a, b]
                while q >= 0:
                    near = abs(height[q] - height[p]) <= STEP_VOXELS * voxel
                    if near and not seen[q] and abs(height[q] - height[start]) <= DRIFT_VOXELS * voxel:
                        seen[q], queue[tail] = True, q
                        tail += 1
                        mine += own[q]
                    q = following[q]
        if mine >= max(MIN_COLUMNS, MIN_SHARE * columns) and tail - mine <= MAX_GROWTH * mine:
            for place in queue[:tail]:
                added[place] = not own[place]
    return added
