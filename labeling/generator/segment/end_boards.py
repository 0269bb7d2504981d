"""Boards that end objects, such as the heads of beds: upright layers as wide as the side of the object they stand at.

Detectors leave them out of their masks in view after view, as they rise behind what else there is of the object, so
that votes count against them. But a layer of points that begins and ends where the object does belongs to it: a wall
goes on beyond.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64
from numba import njit

from labeling.core.boxes3d import fit_box
from labeling.generator.cloud.ground import MIN_PIXELS, Ground
from labeling.generator.cloud.voxel_cloud import Cloud

OUTSIDE_VOXELS = 5.0
"""How far outside a side of the object's box boards are looked for, in voxels."""
INSIDE_VOXELS = 3.0
"""How far inside."""
GAP_VOXELS = 4.5
"""Largest distance of a board from what the object has at this side, in voxels."""
HIGH = 2.5
"""Height up to which boards are looked for, in heights of the object."""
BELOW_VOXELS = 2.0
"""A board ends by so much below this height and below what else there is behind it, in voxels."""
LAYER_VOXELS = 0.7
"""Thickness of a layer of points, in voxels."""
SLOPES = np.linspace(-0.06, 0.06, 13)
"""How a board may stand to the side of the box, since the box is not exact."""
MARGIN_VOXELS = 1.5
"""So far beyond the corners of the side a board may reach, in voxels."""
RING_VOXELS = 8.0
"""So much further a layer is followed, in voxels."""
RING_LAYER_VOXELS = 0.8
"""Largest distance from the layer at which points of that ring belong to it, in voxels: more than before, so that no
wall is cut askew."""
BEYOND = 0.15
"""Largest number of a layer's points in that ring, as a share of those before it."""
WIDE = 0.85
"""Least width of a board, as a share of that of the side."""
CELL_VOXELS = 1.5
"""Edge of the cells in which a board is seen, in voxels."""
MIN_ROWS = 3
"""Least number of rows of cells in which a board is seen in that width: lower down the object itself may hide it."""
MIN_ROWS_SHARE = 0.2
"""The same as a share of all rows from its lower to its upper end."""
MIN_WIDE_VOXELS = 8.0
"""Least width of a side that has boards, in voxels."""
MIN_POINTS = 24
"""Least number of points of a board; of an object it is four times as many."""
MAX_GROWTH = 0.2
"""Largest number of points of a board, as a share of the object's: more is something else that stands there."""


def complete_end_boards(
    cloud: Cloud,
    owner: Int32[np.ndarray, "n"],
    num_objects: int,
    ground: Ground,
    beside: Mapping[int, Float32[np.ndarray, "n"]] | None = None,
) -> Int32[np.ndarray, "n"]:
    """Finds the points of boards that objects lack at the sides of their boxes.

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
    free = (owner == -1) & (ground.pixels_above >= MIN_PIXELS)
    for k in range(num_objects):
        own = np.flatnonzero(owner == k)
        if len(own) < 4 * MIN_POINTS:
            continue
        for board in _boards(cloud.points, cloud.voxel_m, own, free):
            added = board if not beside or k not in beside else board[beside[k][board] <= 0]
            found[added[found[added] < 0]] = k
    return found


def _boards(
    points: Float32[np.ndarray, "n 3"], voxel_m: float, own: Int64[np.ndarray, "m"], free: Bool[np.ndarray, "n"]
) -> list[Int64[np.ndarray, "b"]]:
    """The boards at the four sides of the object with the points ``own``, of points that are ``free``."""
    box = fit_box(points[own])
    if box is None:
        return []
    half = 0.5 * box.extent_m / voxel_m
    reach_m = (np.hypot(*half[:2]) + RING_VOXELS + OUTSIDE_VOXELS) * voxel_m
    near = np.flatnonzero(free & (np.abs(points[:, :2] - box.centre_m[:2]) <= reach_m).all(axis=1))
    around = (points[near] - box.centre_m) @ box.rotation / voxel_m
    body = (points[own] - box.centre_m) @ box.rotation / voxel_m
    limit, found = 2 * HIGH * half[2], []
    for axis in (0, 1):
        wide = half[1 - axis]
        if 2 * wide < MIN_WIDE_VOXELS:
            continue
        for sign in (1.0, -1.0):
            out, side, high = _seen_from(around, axis, sign, half)
            zone = (out >= -INSIDE_VOXELS) & (out <= OUTSIDE_VOXELS) & (np.abs(side) <= wide + RING_VOXELS)
            rows = np.flatnonzero(zone & (high >= 0) & (high <= limit))
            if len(rows) < MIN_POINTS:
                continue
            highest = min(limit, float(np.quantile(high[rows], 0.99))) - BELOW_VOXELS
            board, at = _board(out[rows], side[rows], high[rows], wide, highest, MAX_GROWTH * len(own))
            own_out, own_side, _ = _seen_from(body, axis, sign, half)
            if len(board) and at - np.quantile(own_out[np.abs(own_side) <= wide], 0.98) <= GAP_VOXELS:
                found.append(near[rows[board]])
    return found


def _seen_from(places: Float64[np.ndarray, "m 3"], axis: int, sign: float, half: Float64[np.ndarray, "3"]):
    """Where points (in the axes of the box, from its middle) lie from a side: outwards from it, along it from its
    middle, and above the bottom of the box.
    """
    return sign * places[:, axis] - half[axis], places[:, 1 - axis], places[:, 2] + half[2]


@njit(cache=True, nogil=True)
def _board(out, side, high, wide, highest, most):  # pragma: no cover - compiled
    """The board with the most points at a side of a box.

    Args:
        out: (m,) float64, where points lie outwards from the side, in voxels.
        side: (m,) float64, along it from its middle.
        high: (m,) float64, above the bottom of the box.
        wide: half the width of the side.
        highest: below this a board ends.
        most: largest number of its points.

    Returns:
        Its points (b,) int64, none if there is no board, and how far out it is.
    """
    inner = np.abs(side) <= wide + MARGIN_VOXELS
    within, ring = np.flatnonzero(inner), np.flatnonzero(~inner)
    best, best_out = np.empty(0, np.int64), 0.0
    for slope in SLOPES:
        level = out - slope * side
        order = within[np.argsort(level[within])]
        end, count = 0, np.zeros(len(order), np.int64)
        for begin in range(len(order)):
            while end < len(order) and level[order[end]] - level[order[begin]] <= LAYER_VOXELS:
                end += 1
            count[begin] = end - begin
        taken = np.zeros(len(order), np.bool_)
        for first in np.argsort(-count, kind="mergesort"):
            last = first + count[first] - 1
            if count[first] < MIN_POINTS or count[first] <= len(best):
                break
            if taken[first] or taken[last]:
                continue
            taken[first : last + 1] = True
            middle = level[order[(first + last) // 2]]
            members = within[np.abs(level[within] - middle) <= 0.5 * LAYER_VOXELS]
            if len(members) <= max(len(best), MIN_POINTS - 1) or len(members) > most:
                continue
            if np.count_nonzero(np.abs(level[ring] - middle) <= RING_LAYER_VOXELS) > BEYOND * len(members):
                continue
            if _is_board(side[members], high[members], wide, highest):
                best, best_out = members, middle
    return best, best_out


@njit(cache=True, nogil=True)
def _is_board(side, high, wide, highest):  # pragma: no cover - compiled
    """Whether points of a layer, along a side of half the width ``wide`` and above the bottom, are seen in all of this
    width in enough rows, and end below ``highest``.
    """
    if np.quantile(high, 0.98) >= highest:
        return False
    column, row = np.floor((side - side.min()) / CELL_VOXELS + 0.25), np.floor((high - high.min()) / CELL_VOXELS + 0.25)
    filled = np.zeros((int(row.max()) + 1, int(column.max()) + 1), np.bool_)
    for p in range(len(side)):
        filled[int(row[p]), int(column[p])] = True
    wide_rows = np.count_nonzero(filled.sum(axis=1) * CELL_VOXELS >= WIDE * 2 * wide)
    return wide_rows >= max(MIN_ROWS, MIN_ROWS_SHARE * len(filled))
