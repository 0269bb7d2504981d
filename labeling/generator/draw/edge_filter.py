"""Edge-aware smoothing and hole filling in the image plane: a normalised recursive domain-transform filter.

Source: Gastal and Oliveira, "Domain Transform for Edge-Aware Image and Video Processing" (2011), recursive filtering.
Values spread along rows and columns and lose strength where the guide changes, so that a hole takes the values of the
surface it belongs to.

Everything here runs on one thread and leaves Python's lock to others, so that views can be filled side by side.
"""

import numpy as np
from jaxtyping import Float32, UInt8
from numba import njit

ITERATIONS = 3
"""Passes over rows and columns, each half as wide as the one before."""
REACH_FACTOR = 6.0
"""So many times the reach away from where it was known, a value has lost all but 1/10,000 of its strength."""
_ROWS = 8
"""Rows filtered side by side: each waits for its own last pixel only."""


def feedback_maps(
    guide: UInt8[np.ndarray, "h w 3"], reach_px: float, edge: float
) -> tuple[Float32[np.ndarray, "i h w"], Float32[np.ndarray, "i h w"]]:
    """How much of its left and of its upper neighbour each pixel takes, for every iteration."""
    steps = np.arange(3 * 255 + 1) / 255.0
    # Equation 14: widths halve from pass to pass and their squares add up to reach_px^2.
    halving = 2.0 ** (ITERATIONS - 1 - np.arange(ITERATIONS))
    sigma = reach_px * np.sqrt(3.0) * halving / np.sqrt(4.0**ITERATIONS - 1.0)
    table = np.exp(-np.sqrt(2.0) / sigma)[:, None] ** (1.0 + reach_px / edge * steps)
    return _feedback(np.ascontiguousarray(guide), table.astype(np.float32))


@njit(cache=True, nogil=True)
def _feedback(guide, table):  # pragma: no cover - compiled
    """The maps of ``feedback_maps``.

    Args:
        guide: (h, w, channels) uint8.
        table: (iterations, 766) float32, feedback by the sum over channels of the change of colour.
    """
    height, width, channels = guide.shape
    iterations = len(table)
    across = np.empty((iterations, height, width), np.float32)
    down = np.empty((iterations, height, width), np.float32)
    for y in range(height):
        for x in range(width):
            left, up = 0, 0
            for c in range(channels):
                here = np.int32(guide[y, x, c])
                if x > 0:
                    left += abs(here - np.int32(guide[y, x - 1, c]))
                if y > 0:
                    up += abs(here - np.int32(guide[y - 1, x, c]))
            for i in range(iterations):
                across[i, y, x] = table[i, left]
                down[i, y, x] = table[i, up]
    return across, down


@njit(cache=True, nogil=True)
def smooth(plane, across, down):  # pragma: no cover - compiled
    """Filters a picture in place.

    Args:
        plane: (h, w) float32.
        across: (iterations, h, w) float32, feedback along rows, of the same window of the guide.
        down: the same along columns.
    """
    height, width = plane.shape
    last = np.empty(_ROWS, np.float32)
    for i in range(len(across)):
        for top in range(0, height, _ROWS):
            rows = min(_ROWS, height - top)
            for r in range(rows):
                last[r] = plane[top + r, 0]
            for x in range(1, width):
                for r in range(rows):
                    value = plane[top + r, x]
                    last[r] = value + across[i, top + r, x] * (last[r] - value)
                    plane[top + r, x] = last[r]
            for x in range(width - 2, -1, -1):
                for r in range(rows):
                    value = plane[top + r, x]
                    last[r] = value + across[i, top + r, x + 1] * (last[r] - value)
                    plane[top + r, x] = last[r]
        for y in range(1, height):
            for x in range(width):
                value = plane[y, x]
                plane[y, x] = value + down[i, y, x] * (plane[y - 1, x] - value)
        for y in range(height - 2, -1, -1):
            for x in range(width):
                value = plane[y, x]
                plane[y, x] = value + down[i, y + 1, x] * (plane[y + 1, x] - value)
