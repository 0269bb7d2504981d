"""Pixels of a picture."""

import numpy as np


def pixel_grid(height_px: int, width_px: int) -> np.ndarray:
    """The (x, y) coordinates of all pixel centres, row by row."""
    y, x = np.indices((height_px, width_px), dtype=float)
    return np.stack([x.ravel(), y.ravel()], axis=1)
