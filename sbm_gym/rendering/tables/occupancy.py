"""A coarse grid of how much of space is filled: what ambient light has to get past."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32
from numba import njit

FINEST_CELL_M = 0.10
"""Small enough to darken the space under a chair, large enough to stay smooth."""
MAX_CELLS = 2_000_000
"""Larger worlds get larger cells: 8 MB at most."""
MAX_DIVISIONS = 1024
"""Along an edge of one triangle."""
SURFACE_WEIGHT = 0.9
"""How far a surface that crosses a whole cell fills it."""


class FilledSpace(NamedTuple):
    """Blurred share of each cell that is filled; (z, y, x)."""

    density: Float32[np.ndarray, "z y x"]
    origin_m: Float[np.ndarray, "3"]
    cell_m: float


def bounds_of(corners: Float32[np.ndarray, "n 3 3"]) -> Float32[np.ndarray, "2 3"]:
    """Low and high corner of the box around some triangles, of which there is one at least."""
    return _bounds(corners.reshape(-1, 3))


@njit(cache=True, nogil=True)
def _bounds(points):
    bounds = np.empty((2, 3), points.dtype)
    bounds[0] = bounds[1] = points[0]
    for n in range(1, len(points)):
        for axis in range(3):
            bounds[0, axis] = min(bounds[0, axis], points[n, axis])
            bounds[1, axis] = max(bounds[1, axis], points[n, axis])
    return bounds


def fill_space(corners: Float32[np.ndarray, "n 3 3"]) -> FilledSpace:
    """Counts surface area per cell and blurs it.

    Args:
        corners: triangles, world frame, metres.

    Returns:
        The grid; a single empty cell if there is nothing.
    """
    import cv2

    if len(corners) == 0:
        return FilledSpace(np.zeros((2, 2, 2), np.float32), np.zeros(3), 1.0)
    low, high = bounds_of(corners).astype(float)
    cell = max(FINEST_CELL_M, float(np.prod(high - low + 0.4) / MAX_CELLS) ** (1 / 3))
    origin = low - 2 * cell
    shape = (np.ceil((high - origin) / cell).astype(int) + 2)[::-1]
    area = np.zeros(tuple(int(side) for side in shape))
    _add_area(np.ascontiguousarray(corners), origin, cell, area)
    density = np.minimum(area / cell**2, 1.0).astype(np.float32) * SURFACE_WEIGHT
    kernel = np.array([0.25, 0.5, 0.25], np.float32)
    rows = density.reshape(shape[0] * shape[1], shape[2])
    rows = cv2.filter2D(rows, -1, kernel[None])
    planes = rows.reshape(shape)
    planes = np.stack([cv2.filter2D(plane, -1, kernel[:, None]) for plane in planes])
    stack = cv2.filter2D(planes.reshape(shape[0], -1), -1, kernel[:, None])
    return FilledSpace(np.ascontiguousarray(stack.reshape(shape)), origin, cell)


@njit(cache=True, nogil=True)
def _add_area(corners, origin, cell, area):
    """Adds each triangle's area to the cells it lies in, by points at most half a cell apart."""
    for n in range(corners.shape[0]):
        ax, ay, az = corners[n, 0, 0], corners[n, 0, 1], corners[n, 0, 2]
        ux, uy, uz = corners[n, 1, 0] - ax, corners[n, 1, 1] - ay, corners[n, 1, 2] - az
        vx, vy, vz = corners[n, 2, 0] - ax, corners[n, 2, 1] - ay, corners[n, 2, 2] - az
        cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        whole = 0.5 * math.sqrt(cx * cx + cy * cy + cz * cz)
        wx, wy, wz = vx - ux, vy - uy, vz - uz
        longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz)
        count = min(max(math.ceil(math.sqrt(longest) / (0.5 * cell)), 1), MAX_DIVISIONS)
        share = whole / (count * count)
        for i in range(count):
            for j in range(count - i):
                # The equal parts of a triangle: upright ones, and between them inverted ones.
                for inverted in range(2):
                    if inverted == 1 and j == count - i - 1:
                        continue
                    u = (i + (1.0 + inverted) / 3.0) / count
                    v = (j + (1.0 + inverted) / 3.0) / count
                    x = int((ax + u * ux + v * vx - origin[0]) / cell)
                    y = int((ay + u * uy + v * vy - origin[1]) / cell)
                    z = int((az + u * uz + v * vz - origin[2]) / cell)
                    area[z, y, x] += share
