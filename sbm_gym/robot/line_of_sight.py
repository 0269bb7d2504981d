"""Lines of sight: what stands before a point."""

import numba
import numpy as np


@numba.njit(cache=True)
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
    free = np.ones(len(eyes_m), np.bool_)
    for number in range(len(eyes_m)):
        dx, dy, dz = eyes_m[number] - target_m
        distance_m = np.sqrt(dx * dx + dy * dy + dz * dz)
        sample = 0
        while True:
            along_m = stop_short_m + sample * 0.5 * cell_m
            if along_m >= distance_m - clear_m:
                break
            share = along_m / distance_m
            i = int(np.floor((target_m[0] + share * dx - origin_m[0]) / cell_m))
            j = int(np.floor((target_m[1] + share * dy - origin_m[1]) / cell_m))
            k = int(np.floor((target_m[2] + share * dz - origin_m[2]) / cell_m))
            within = 0 <= i < filled.shape[0] and 0 <= j < filled.shape[1] and 0 <= k < filled.shape[2]
            if within and filled[i, j, k]:
                free[number] = False
                break
            sample += 1
    return free
