"""Looking several views ahead: what the best views after a first one still add.

Of every first view worth a thought the rest of the episode is played through: again and again the view that promises
most for the steps it costs, without what the views before it have shown already. The first view whose sum is highest is
the one to go for.

Source: the rollout algorithm (Bertsekas, Tsitsiklis and Wu 1997, "Rollout algorithms for combinatorial optimization"),
with the greedy view planner as its base.
"""

import numba
import numpy as np


@numba.njit(cache=True)
def shortest_ways(ways_m):
    """Lengths of the shortest ways between all places (Floyd and Warshall), in place.

    Args:
        ways_m: places x places, symmetric; of the direct ways, infinite where there is none.
    """
    count = len(ways_m)
    for k in range(count):
        for i in range(count):
            first = ways_m[i, k]
            if first == np.inf:
                continue
            for j in range(count):
                through = first + ways_m[k, j]
                if through < ways_m[i, j]:
                    ways_m[i, j] = through


@numba.njit(cache=True)
def rollouts(firsts, first_steps, tables, sector_size, detail, again, bins, sight, bearings, headings, in_view_rad, steps, left, path_cost, discount, depth):
    num_targets, num_places = bins.shape
    num_headings = len(headings)
    spacing = 2.0 * np.pi / num_headings
    values = np.zeros(len(firsts))
    # what can be seen from each place
    start = np.zeros(num_places + 1, np.int64)
    for p in range(num_places):
        n = 0
        for t in range(num_targets):
            if sight[t, p] > 0.0:
                n += 1
        start[p + 1] = start[p] + n
    seen = np.zeros(start[num_places], np.int64)
    for p in range(num_places):
        n = start[p]
        for t in range(num_targets):
            if sight[t, p] > 0.0:
                seen[n] = t
                n += 1
    gains = np.zeros(num_headings)
    best_gain = np.zeros(num_places)
    best_heading = np.zeros(num_places, np.int64)
    for number in range(len(firsts)):
        table = tables.copy()
        stale = np.ones(num_places, np.bool_)
        touched = np.zeros(num_targets, np.bool_)
        at = firsts[number]
        taken = first_steps[number]
        for view in range(depth):
            if view > 0:
                top, at_top = 0.0, -1
                for p in range(num_places):
                    if taken + steps[at, p] > left or start[p] == start[p + 1]:
                        continue
                    if stale[p]:
                        gains[:] = 0.0
                        for n in range(start[p], start[p + 1]):
                            t = seen[n]
                            w = table[t, bins[t, p]] * sight[t, p]
                            if w > 0.0:
                                for h in range(num_headings):
                                    side = (bearings[t, p] - headings[h] + np.pi) % (2.0 * np.pi) - np.pi
                                    if abs(side) < in_view_rad:
                                        gains[h] += w
                        best_heading[p] = np.argmax(gains)
                        best_gain[p] = gains[best_heading[p]]
                        stale[p] = False
                    value = best_gain[p] * np.exp(-path_cost * steps[at, p])
                    if value > top:
                        top, at_top = value, p
                if at_top < 0:
                    break
                taken += steps[at, at_top]
                at = at_top
            else:
                gains[:] = 0.0
                for n in range(start[at], start[at + 1]):
                    t = seen[n]
                    w = table[t, bins[t, at]] * sight[t, at]
                    if w > 0.0:
                        for h in range(num_headings):
                            side = (bearings[t, at] - headings[h] + np.pi) % (2.0 * np.pi) - np.pi
                            if abs(side) < in_view_rad:
                                gains[h] += w
                best_heading[at] = np.argmax(gains)
                best_gain[at] = gains[best_heading[at]]
            values[number] += best_gain[at] * np.exp(-discount * taken)
            touched[:] = False
            for n in range(start[at], start[at + 1]):
                t = seen[n]
                side = (bearings[t, at] - headings[best_heading[at]] + np.pi) % (2.0 * np.pi) - np.pi
                if abs(side) < in_view_rad:
                    touched[t] = True
                    cell = bins[t, at]
                    low = cell // sector_size * sector_size
                    for c in range(low, low + sector_size):
                        table[t, c] = min(table[t, c], detail[t])
                    table[t, cell] = 0.0
                    if again[t] < 1.0:
                        table[t] *= again[t]
            for p in range(num_places):
                for n in range(start[p], start[p + 1]):
                    if touched[seen[n]]:
                        stale[p] = True
                        break
    return values
