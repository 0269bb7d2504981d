"""Compiled loops over the cells of a grid."""

import numba
import numpy as np


@numba.njit(cache=True)
def line_is_free(free, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether every cell that a straight line enters is free, and none lies beyond the grid.

    Args:
        free: grid, row i and column j cover [j, j + 1] x [i, i + 1].
        ax: column coordinate of where it begins, in cells.
        ay: row coordinate.
        bx: column coordinate of where it ends.
        by: row coordinate.
    """
    rows, columns = free.shape
    dx, dy = bx - ax, by - ay
    for x, y in ((ax, ay), (bx, by)):
        j, i = int(np.floor(x)), int(np.floor(y))
        if i < 0 or j < 0 or i >= rows or j >= columns or not free[i, j]:
            return False
    # Lines of the grid that it crosses, in order of where on the line that is; between two of them lies one cell.
    step_x, step_y = (1.0 if dx > 0.0 else -1.0), (1.0 if dy > 0.0 else -1.0)
    next_x = np.ceil(ax) if dx > 0.0 else np.floor(ax)
    next_y = np.ceil(ay) if dy > 0.0 else np.floor(ay)
    t = 0.0
    while t < 1.0:
        tx = (next_x - ax) / dx if dx != 0.0 else np.inf
        ty = (next_y - ay) / dy if dy != 0.0 else np.inf
        after = min(tx, ty, 1.0)
        if after - t > 1e-12:
            middle = 0.5 * (t + after)
            j, i = int(np.floor(ax + middle * dx)), int(np.floor(ay + middle * dy))
            if i < 0 or j < 0 or i >= rows or j >= columns or not free[i, j]:
                return False
        if tx <= after:
            next_x += step_x
        if ty <= after:
            next_y += step_y
        t = max(t, after)
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def first_straight(free, origin_m, cell_m, x: float, y: float, ends_m) -> int:
    """The first of some places to which ``line_is_free`` from a place, -1 if there is none.

    Args:
        free: as there.
        origin_m: (2,) float64, x and y of the grid's lower corner.
        cell_m: edge length of a cell.
        x: of where to start, metres.
        y: likewise.
        ends_m: (n, 2) float64.
    """
    ax, ay = (x - origin_m[0]) / cell_m, (y - origin_m[1]) / cell_m
    for number in range(len(ends_m)):
        bx, by = (ends_m[number, 0] - origin_m[0]) / cell_m, (ends_m[number, 1] - origin_m[1]) / cell_m
        if line_is_free(free, ax, ay, bx, by):
            return number
    return -1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def free_steps(free, origin_m, cell_m, x: float, y: float, directions, most: int):
    """How many steps of a cell's length one can go in some directions before a place that is not free.

    Args:
        free: grid, row i and column j; nothing beyond it is free.
        origin_m: (2,) float64, x and y of its lower corner.
        cell_m: edge length of a cell.
        x: of where to start, metres.
        y: likewise.
        directions: (n, 2) float64, unit vectors.
        most: steps to look at.

    Returns:
        (n,) int64.
    """
    rows, columns = free.shape
    steps = np.full(len(directions), most)
    for number in range(len(directions)):
        for step in range(most):
            along_m = (step + 1) * cell_m
            j = int(np.floor((x + along_m * directions[number, 0] - origin_m[0]) / cell_m))
            i = int(np.floor((y + along_m * directions[number, 1] - origin_m[1]) / cell_m))
            if not (0 <= i < rows and 0 <= j < columns and free[i, j]):
                steps[number] = step
                break
    return steps
