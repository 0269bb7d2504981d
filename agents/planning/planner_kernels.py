"""Compiled loops of the view planner: ways over a grid, and what looks from many places promise."""

import heapq

import numba
import numpy as np

from sbm_gym.robot.line_of_sight import unhidden


@numba.njit(cache=True)
def ways_over_grid(free, spacing_m: float, reach_m: float):
    """Lengths of the shortest ways from the middle of a grid, over eight neighbours.

    Args:
        free: odd square grid at half the spacing: nodes at even places of it counted from the middle, and between two
            neighbouring nodes the place that must be free as well.
        spacing_m: between neighbouring nodes.
        reach_m: longest way.

    Returns:
        For each node the length, infinite where no way is short enough.
    """
    count = (free.shape[0] + 1) // 2
    ways_m = np.full((count, count), np.inf)
    start = count // 2
    if not free[2 * start, 2 * start]:
        return ways_m
    ways_m[start, start] = 0.0
    waiting = [(0.0, start, start)]
    while len(waiting) > 0:
        way_m, i, j = heapq.heappop(waiting)
        if way_m > ways_m[i, j]:
            continue
        for di in range(-1, 2):
            for dj in range(-1, 2):
                ni, nj = i + di, j + dj
                if (di == 0 and dj == 0) or ni < 0 or nj < 0 or ni >= count or nj >= count:
                    continue
                if not free[2 * ni, 2 * nj] or not free[i + ni, j + nj]:
                    continue
                longer_m = way_m + spacing_m * np.sqrt(float(di * di + dj * dj))
                if longer_m < ways_m[ni, nj] and longer_m <= reach_m:
                    ways_m[ni, nj] = longer_m
                    heapq.heappush(waiting, (longer_m, ni, nj))
    return ways_m


@numba.njit(cache=True)
def promised(worth, eyes_m, centres_m, stop_short_m, headings, in_view_rad: float, filled, origin_m, cell_m, clear_m):
    """What a look from each place in each direction promises.

    Args:
        worth: targets x places; what seeing each target from each place is worth if nothing hides it.
        eyes_m: places x 3.
        centres_m: targets x 3.
        stop_short_m: of each target, how near to it nothing can hide it.
        headings: directions of looks, radians.
        in_view_rad: what is less to the side of a look is in it.
        filled: grid of cells that hide things, as for ``unhidden``.
        origin_m: its lower corner.
        cell_m: edge length of a cell.
        clear_m: so near to the eye nothing hides anything.

    Returns:
        Places x directions.
    """
    gains = np.zeros((len(eyes_m), len(headings)))
    for target in range(len(centres_m)):
        wanted = np.flatnonzero(worth[target] > 0.0)
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
                    gains[place, direction] += worth[target, place]
    return gains
