"""Edge-aware hole filling of whole pictures: what the windows of ``view_masks`` are compared with."""

import numpy as np

from labeling.generator.draw.edge_filter import ITERATIONS, feedback_maps, next_iteration, smooth_once


def edge_aware_fill(
    values: np.ndarray, weight: np.ndarray, guide: np.ndarray, reach_px: float, edge: float
) -> tuple[np.ndarray, np.ndarray]:
    """Weighted means of channels (h, w, c), and the total weight (h, w) that reached each pixel."""
    maps = feedback_maps(guide, reach_px, edge)
    total = np.array(weight, np.float32, order="C")
    smooth(total, *maps)
    means = np.empty(values.shape, np.float32)
    for channel in range(values.shape[2]):
        plane = np.ascontiguousarray(values[:, :, channel] * weight, np.float32)
        smooth(plane, *maps)
        means[:, :, channel] = plane / np.maximum(total, np.float32(1e-12))
    return means, total


def smooth(plane: np.ndarray, across: np.ndarray, down: np.ndarray) -> None:
    """Filters a whole picture (h, w) in place by its ``feedback_maps``."""
    across, down = across.copy(), down.copy()
    for _ in range(ITERATIONS):
        smooth_once(plane, across, down, 0, 0)
        next_iteration(across, down)
