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
_LANES = 16
"""Rows filtered side by side: each waits for its own last pixel only."""


def feedback_maps(
    guide: UInt8[np.ndarray, "h w 3"], reach_px: float, edge: float
) -> tuple[Float32[np.ndarray, "w hp"], Float32[np.ndarray, "h w"]]:
    """How much of its left and of its upper neighbour each pixel takes in the first, widest iteration.

    Returns:
        The first column by column, with columns longer than the picture is high.
    """
    steps = np.arange(3 * 255 + 1) / 255.0
    # Equation 14: widths halve from pass to pass and their squares add up to reach_px^2.
    sigma = reach_px * np.sqrt(3.0) * 2.0 ** (ITERATIONS - 1) / np.sqrt(4.0**ITERATIONS - 1.0)
    table = np.exp(-np.sqrt(2.0) / sigma) ** (1.0 + reach_px / edge * steps)
    return _feedback(guide, table.astype(np.float32))


@njit(cache=True, nogil=True)
def _feedback(guide, table):  # pragma: no cover - compiled
    """The maps of ``feedback_maps``.

    Args:
        guide: (h, w, 3) uint8.
        table: (766,) float32, feedback by the sum over channels of the change of colour.
    """
    height, width, _ = guide.shape
    across = np.zeros((width, height + _LANES), np.float32)
    down = np.empty((height, width), np.float32)
    for y in range(height):
        above = max(y - 1, 0)
        for x in range(width):
            before = max(x - 1, 0)
            left, up = np.int32(0), np.int32(0)
            for c in range(3):
                here = np.int32(guide[y, x, c])
                left += abs(here - np.int32(guide[y, before, c]))
                up += abs(here - np.int32(guide[above, x, c]))
            across[x, y] = table[left]
            down[y, x] = table[up]
    return across, down


@njit(cache=True, nogil=True)
def next_iteration(across, down):  # pragma: no cover - compiled
    """Turns the maps into those of the next iteration, in place: half the width squares the feedback."""
    for one in (across, down):
        for y in range(one.shape[0]):
            for x in range(one.shape[1]):
                one[y, x] *= one[y, x]


@njit(cache=True, nogil=True)
def smooth_once(plane, across, down, top, left):  # pragma: no cover - compiled
    """One iteration over a window of the picture, in place.

    Args:
        plane: (h, w) float32, the window.
        across: feedback along rows, of the picture (``feedback_maps``).
        down: feedback along columns.
        top: first row of the window.
        left: its first column.
    """
    height, width = plane.shape
    columns = np.zeros((width, _LANES), np.float32)
    for first in range(0, height, _LANES):
        rows = min(_LANES, height - first)
        lanes = across[left : left + width, top + first : top + first + _LANES]
        for r in range(rows):
            row = plane[first + r]
            for x in range(width):
                columns[x, r] = row[x]
        for x in range(1, width):
            _follow(columns[x], columns[x - 1], lanes[x])
        for x in range(width - 2, -1, -1):
            _follow(columns[x], columns[x + 1], lanes[x + 1])
        for r in range(rows):
            row = plane[first + r]
            for x in range(width):
                row[x] = columns[x, r]
    for y in range(1, height):
        _follow(plane[y], plane[y - 1], down[top + y, left : left + width])
    for y in range(height - 2, -1, -1):
        _follow(plane[y], plane[y + 1], down[top + y + 1, left : left + width])


@njit(cache=True, inline="always")
def _follow(values, before, feedback):  # pragma: no cover - compiled
    """Moves ``values`` (n,) towards those ``before`` them, in place."""
    for i in range(len(values)):
        values[i] += feedback[i] * (before[i] - values[i])
