"""Compiled loops over places: shortest paths over a grid, ways to unseen floor, expected gains of looks, new sides that
are seen.
"""

import heapq

import numba
import numpy as np

from sbm_gym.robot.line_of_sight import unhidden


@numba.njit(cache=True)
def grid_path_lengths(free, spacing_m: float, max_length_m: float):
    """Lengths of the shortest paths from the middle of a grid to its nodes, over eight neighbours (Dijkstra).

    Args:
        free: (2 n - 1, 2 n - 1) bool, n odd: where the robot can stand, at half the spacing of the nodes. Nodes are at
            even indices; what lies between two neighbouring nodes must be free as well.
        spacing_m: between neighbouring nodes.
        max_length_m: longest path.

    Returns:
        (n, n) float64, metres; infinite where no path is short enough.
    """
    count = (free.shape[0] + 1) // 2
    lengths_m = np.full((count, count), np.inf)
    start = count // 2
    if not free[2 * start, 2 * start]:
        return lengths_m
    lengths_m[start, start] = 0.0
    queue = [(0.0, start, start)]
    while len(queue) > 0:
        length_m, i, j = heapq.heappop(queue)
        if length_m > lengths_m[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                ni, nj = i + di, j + dj
                if (di == 0 and dj == 0) or ni < 0 or nj < 0 or ni >= count or nj >= count:
                    continue
                if not free[2 * ni, 2 * nj] or not free[i + ni, j + nj]:
                    continue
                longer_m = length_m + spacing_m * np.sqrt(float(di * di + dj * dj))
                if longer_m < lengths_m[ni, nj] and longer_m <= max_length_m:
                    lengths_m[ni, nj] = longer_m
                    heapq.heappush(queue, (longer_m, ni, nj))
    return lengths_m


@numba.njit(cache=True)
def unseen_by_way(is_floor, is_unseen, row: int, column: int, cell_strides: float, angles, path_cost: float):
    """Unseen floor by the side on which the shortest way to it begins, less the longer the way.

    Args:
        is_floor: (my, mx) bool, cells where the robot can be.
        is_unseen: (my, mx) bool, those of them that it has not seen.
        row: of the cell it stands in.
        column: likewise.
        cell_strides: edge length of a cell, strides.
        angles: (d,) float64, sides, radians, counter-clockwise from +X (columns).
        path_cost: unseen floor counts exp(-path_cost) for each stride of the way.

    Returns:
        (d,) float64, squares of a stride: what lies on the ways that begin on each side, times the cosine of the angle
        between the two, where that is positive.
    """
    found = np.zeros(len(angles))
    lengths = np.full(is_floor.shape, np.inf)
    ways = np.zeros(is_floor.shape)
    lengths[row, column] = 0.0
    queue = [(0.0, row, column)]
    while len(queue) > 0:
        length, i, j = heapq.heappop(queue)
        if length > lengths[i, j]:
            continue
        if is_unseen[i, j] and length > 0.0:
            worth = cell_strides * cell_strides * np.exp(-path_cost * length)
            for side in range(len(angles)):
                found[side] += worth * max(np.cos(angles[side] - ways[i, j]), 0.0)
        for di in range(-1, 2):
            for dj in range(-1, 2):
                ni, nj = i + di, j + dj
                if (di == 0 and dj == 0) or ni < 0 or nj < 0 or ni >= is_floor.shape[0] or nj >= is_floor.shape[1]:
                    continue
                if not is_floor[ni, nj] or not is_floor[i, nj] or not is_floor[ni, j]:
                    continue
                longer = length + cell_strides * np.sqrt(float(di * di + dj * dj))
                if longer < lengths[ni, nj]:
                    lengths[ni, nj] = longer
                    # The first stride and a half of a way say where it begins.
                    ways[ni, nj] = np.arctan2(float(ni - row), float(nj - column)) if longer <= 1.5 else ways[i, j]
                    heapq.heappush(queue, (longer, ni, nj))
    return found


@numba.njit(cache=True)
def expected_gains(
    values, eyes_m, centres_m, stop_short_m, headings, in_view_rad: float, filled, origin_m, cell_m, clear_m
):
    """The sum of the values of all targets that a look from each place in each direction shows.

    Args:
        values: (t, p) float64, what seeing each target from each place is worth if nothing hides it.
        eyes_m: (p, 3) float64, camera positions, metres, world.
        centres_m: (t, 3) float64, targets, likewise.
        stop_short_m: (t,) float64, so near to a target nothing can hide it.
        headings: (d,) float64, directions of looks, radians, counter-clockwise from +X.
        in_view_rad: a target at most so far to the side of a look is in it.
        filled: (nx, ny, nz) bool, cells that hide things, as for ``unhidden``.
        origin_m: (3,) float64, lower corner of the first cell.
        cell_m: edge length of a cell.
        clear_m: so near to the eye nothing hides anything.

    Returns:
        (p, d) float64.
    """
    gains = np.zeros((len(eyes_m), len(headings)))
    for target in range(len(centres_m)):
        wanted = np.flatnonzero(values[target] > 0.0)
        if len(wanted) == 0:
            continue
        centre_m = centres_m[target]
        seen = unhidden(filled, origin_m, cell_m, eyes_m[wanted], centre_m, stop_short_m[target], clear_m)
        for number in range(len(wanted)):
            if not seen[number]:
                continue
            place = wanted[number]
            bearing = np.arctan2(centre_m[1] - eyes_m[place, 1], centre_m[0] - eyes_m[place, 0])
            for direction in range(len(headings)):
                side = (bearing - headings[direction] + np.pi) % (2.0 * np.pi) - np.pi
                if abs(side) < in_view_rad:
                    gains[place, direction] += values[target, place]
    return gains


@numba.njit(cache=True)
def new_sides(
    eyes_m,
    centres_m,
    stop_short_m,
    is_done,
    low_m: float,
    high_m: float,
    filled,
    origin_m,
    cell_m: float,
    clear_m: float,
):
    """From which places each target is seen from a side that is not done.

    Args:
        eyes_m: (p, 3) float64, camera positions, metres, world.
        centres_m: (t, 3) float64, targets, likewise.
        stop_short_m: (t,) float64, so near to a target nothing can hide it.
        is_done: (t, s) bool, for each of as many sectors around it, counter-clockwise from +X.
        low_m: least horizontal distance of a place.
        high_m: greatest.
        filled: (nx, ny, nz) bool, cells that hide things, as for ``unhidden``.
        origin_m: (3,) float64, lower corner of the first cell.
        cell_m: edge length of a cell.
        clear_m: so near to the eye nothing hides anything.

    Returns:
        (t, p) bool.
    """
    found = np.zeros((len(centres_m), len(eyes_m)), np.bool_)
    count = is_done.shape[1]
    for target in range(len(centres_m)):
        for place in range(len(eyes_m)):
            dx, dy = eyes_m[place, 0] - centres_m[target, 0], eyes_m[place, 1] - centres_m[target, 1]
            distance_m = np.sqrt(dx * dx + dy * dy)
            sector = min(int(np.floor((np.arctan2(dy, dx) / (2.0 * np.pi)) % 1.0 * count)), count - 1)
            if low_m <= distance_m < high_m and not is_done[target, sector]:
                eye_m = eyes_m[place : place + 1]
                short_m = stop_short_m[target]
                found[target, place] = unhidden(filled, origin_m, cell_m, eye_m, centres_m[target], short_m, clear_m)[0]
    return found
