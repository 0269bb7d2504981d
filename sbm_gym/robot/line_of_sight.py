"""Lines of sight: what stands before a point."""

import numba
import numpy as np


def stop_short(size_m):
    """How near to the middle of an object nothing hides it: what stands there belongs to it.

    Args:
        size_m: largest extent of what has been seen of it, a number or an array.
    """
    return 0.25 + 0.5 * size_m


@numba.njit(cache=True, nogil=True, error_model="numpy")
def unhidden(filled, origin_m, cell_m: float, eyes_m, target_m, stop_short_m: float, clear_m: float):
    """From which eyes no filled cell stands before a target. Every half cell on the way is looked at.

    Args:
        filled: grid of cells along X, Y and Z; what lies beyond it is empty.
        origin_m: its lower corner.
        cell_m: edge length of a cell.
        eyes_m: n x 3.
        target_m: what to look at.
        stop_short_m: so near to the target nothing counts.
        clear_m: nor so near to the eye.

    Returns:
        One flag for each eye.
    """
    free = np.empty(len(eyes_m), np.bool_)
    for number in range(len(eyes_m)):
        x, y, z = eyes_m[number]
        free[number] = _is_unhidden(filled, origin_m, cell_m, x, y, z, target_m, stop_short_m, clear_m)
    return free


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _is_unhidden(filled, origin_m, cell_m, x, y, z, target_m, stop_short_m, clear_m):
    """``unhidden`` of one eye at x, y and z."""
    dx, dy, dz = x - target_m[0], y - target_m[1], z - target_m[2]
    distance_m = np.sqrt(dx * dx + dy * dy + dz * dz)
    sample = 0
    while True:
        along_m = stop_short_m + sample * 0.5 * cell_m
        if along_m >= distance_m - clear_m:
            return True
        share = along_m / distance_m
        i = int(np.floor((target_m[0] + share * dx - origin_m[0]) / cell_m))
        j = int(np.floor((target_m[1] + share * dy - origin_m[1]) / cell_m))
        k = int(np.floor((target_m[2] + share * dz - origin_m[2]) / cell_m))
        within = 0 <= i < filled.shape[0] and 0 <= j < filled.shape[1] and 0 <= k < filled.shape[2]
        if within and filled[i, j, k]:
            return False
        sample += 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def open_sectors(
    filled, origin_m, cell_m, floor, floor_origin_m, floor_cell_m, target_m, offsets_m, height_m, stop_short_m, clear_m
):
    """In which directions from a target there is a place on free floor from which nothing stands before it.

    Args:
        filled: as for ``unhidden``, as are its lower corner and the edge length of its cells.
        origin_m: see filled.
        cell_m: see filled.
        floor: (ny, nx) bool, whether one can stand there; row i, column j, nothing beyond.
        floor_origin_m: (2,) float64, x and y of its lower corner.
        floor_cell_m: edge length of its cells.
        target_m: (3,) float64, what to look at.
        offsets_m: (distances, directions, 2) float64, x and y of the places, from the target.
        height_m: of the eyes.
        stop_short_m: as for ``unhidden``, as is clear_m.
        clear_m: see stop_short_m.

    Returns:
        (directions,) bool.
    """
    seen = np.zeros(offsets_m.shape[1], np.bool_)
    for distance in range(offsets_m.shape[0]):
        for direction in range(offsets_m.shape[1]):
            x = target_m[0] + offsets_m[distance, direction, 0]
            y = target_m[1] + offsets_m[distance, direction, 1]
            j, i = (
                int(np.floor((x - floor_origin_m[0]) / floor_cell_m)),
                int(np.floor((y - floor_origin_m[1]) / floor_cell_m)),
            )
            if seen[direction] or not (0 <= i < floor.shape[0] and 0 <= j < floor.shape[1] and floor[i, j]):
                continue
            seen[direction] = _is_unhidden(filled, origin_m, cell_m, x, y, height_m, target_m, stop_short_m, clear_m)
    return seen
