"""Edge-aware smoothing and hole filling in the image plane: a normalised recursive domain-transform filter.

Source: Gastal and Oliveira, "Domain Transform for Edge-Aware Image and Video Processing" (2011), recursive filtering.
Values spread along rows and columns and lose strength where the guide changes, so that a hole takes the values of the
surface it belongs to.
"""

import numpy as np
from jaxtyping import Float32
from numba import njit, prange


def edge_aware_fill(
    values: Float32[np.ndarray, "h w c"],
    weight: Float32[np.ndarray, "h w"],
    guide: Float32[np.ndarray, "h w g"],
    reach_px: float,
    edge: float,
    iterations: int = 3,
) -> tuple[Float32[np.ndarray, "h w c"], Float32[np.ndarray, "h w"]]:
    """Weighted means of ``values`` over neighbourhoods that end at edges of the guide.

    Args:
        values: channels; read only where the weight is positive.
        weight: trust in each pixel, 0 in holes.
        guide: picture whose edges stop the spreading.
        reach_px: standard deviation of the smoothing in pixels, where the guide is flat.
        edge: change of the guide (summed over its channels) that counts as much as ``reach_px`` pixels.
        iterations: passes over rows and columns, each half as wide as the one before.

    Returns:
        The means, and the total weight that reached each pixel (0: nothing known nearby).
    """
    guide = np.ascontiguousarray(guide, np.float32)
    across = np.zeros(guide.shape[:2], np.float32)
    down = np.zeros(guide.shape[:2], np.float32)
    across[:, 1:] = np.abs(np.diff(guide, axis=1)).sum(axis=2)
    down[1:] = np.abs(np.diff(guide, axis=0)).sum(axis=2)
    stack = np.concatenate([values * weight[:, :, None], weight[:, :, None]], axis=2).astype(np.float32)
    for i in range(iterations):
        # Equation 14: widths halve from pass to pass and their squares add up to reach_px^2.
        sigma = reach_px * np.sqrt(3.0) * 2.0 ** (iterations - i - 1) / np.sqrt(4.0**iterations - 1.0)
        base = np.float32(np.exp(-np.sqrt(2.0) / sigma))
        ratio = np.float32(reach_px / edge)
        _filter_rows(stack, base ** (1.0 + ratio * across))
        _filter_columns(stack, base ** (1.0 + ratio * down))
    total = stack[:, :, -1]
    return stack[:, :, :-1] / np.maximum(total, 1e-12)[:, :, None], total


@njit(cache=True, parallel=True)
def _filter_rows(image, feedback):  # pragma: no cover - compiled
    height, width, channels = image.shape
    for y in prange(height):
        for x in range(1, width):
            a = feedback[y, x]
            for c in range(channels):
                image[y, x, c] = (1 - a) * image[y, x, c] + a * image[y, x - 1, c]
        for x in range(width - 2, -1, -1):
            a = feedback[y, x + 1]
            for c in range(channels):
                image[y, x, c] = (1 - a) * image[y, x, c] + a * image[y, x + 1, c]


@njit(cache=True, parallel=True)
def _filter_columns(image, feedback):  # pragma: no cover - compiled
    height, width, channels = image.shape
    strip = 16
    for block in prange((width + strip - 1) // strip):
        first, last = block * strip, min(width, (block + 1) * strip)
        for y in range(1, height):
            for x in range(first, last):
                a = feedback[y, x]
                for c in range(channels):
                    image[y, x, c] = (1 - a) * image[y, x, c] + a * image[y - 1, x, c]
        for y in range(height - 2, -1, -1):
            for x in range(first, last):
                a = feedback[y + 1, x]
                for c in range(channels):
                    image[y, x, c] = (1 - a) * image[y, x, c] + a * image[y + 1, x, c]
