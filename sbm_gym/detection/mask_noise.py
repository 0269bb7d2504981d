"""Simulated errors of a segmentation network's masks: noisy boundaries, leaks into neighbours, missing parts."""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from sbm_gym.detection import mask_kernels


def corrupt_mask(
    rng: np.random.Generator, mask: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"], error: float
) -> Bool[np.ndarray, "h w"]:
    """A mask such as a network would have drawn for what ``mask`` shows.

    Args:
        rng: decides what goes wrong.
        mask: the true modal mask, not empty.
        depth_m: z-depth of the view; leaks flow to where depth is alike.
        error: from 0 (a boundary wrong by about one pixel) to 1 (about half of the object missing or as much added).

    Returns:
        The mask; may be empty.
    """
    area_px, top, left, bottom, right = mask_kernels.window_of(mask, 0.4, 2.0)
    size_px = float(np.sqrt(area_px))
    true = mask.view(np.uint8)[top:bottom, left:right]
    inside_px = cv2.distanceTransform(true, cv2.DIST_L2, 3)
    outside_px = cv2.distanceTransform(true ^ 1, cv2.DIST_L2, 3)
    field = smooth_field(rng, true.shape, cells=5)
    # Networks respect depth and colour edges better than a noisy boundary does: far-off background rarely joins.
    wobble, foreign_px = 0.35 + (0.015 + 0.11 * error) * size_px, -1.0 - 0.04 * size_px
    bias_px = rng.normal(0.0, 0.02 + 0.05 * error) * size_px
    drawn = np.zeros(mask.shape, bool)
    count = mask_kernels.move_boundary(
        mask,
        depth_m,
        top,
        left,
        inside_px,
        outside_px,
        field,
        np.float32(wobble),
        np.float32(bias_px),
        np.float32(foreign_px),
        mask_kernels.median_depth(mask, depth_m),
        drawn,
    )
    if rng.random() < 0.1 + 0.6 * error:
        share = float(rng.uniform(0.05, 0.15 + 0.45 * error))
        if count:
            _cut_part(rng, drawn, (top, left), true.shape, share)
    if rng.random() < 0.1 + 0.6 * error:
        radius_px = size_px * float(rng.uniform(0.15, 0.3 + 0.5 * error))
        _leak(rng, drawn, mask, depth_m, (top, left), true.shape, radius_px)
    return drawn


def phantom_mask(
    rng: np.random.Generator, depth_m: Float[np.ndarray, "h w"], min_share: float = 0.05, max_share: float = 0.35
) -> Bool[np.ndarray, "h w"]:
    """A mask of nothing in particular: a smooth blob on one surface, as false positives are; may be empty.

    Args:
        rng: decides where.
        depth_m: z-depth of the view.
        min_share: smallest diameter as a share of the picture's width.
        max_share: largest diameter.
    """
    height_px, width_px = depth_m.shape
    y, x = int(rng.integers(height_px)), int(rng.integers(width_px))
    radii_px = 0.5 * width_px * rng.uniform(min_share, max_share, 2)
    field = smooth_field(rng, depth_m.shape, cells=6)
    return mask_kernels.blob(depth_m, field, y, x, radii_px[0], radii_px[1])


def smooth_field(rng: np.random.Generator, shape: tuple[int, int], cells: int) -> Float[np.ndarray, "h w"]:
    """Gaussian noise of about unit variance that varies over ``1/cells`` of the longer side."""
    longest = max(shape)
    grid = (max(2, round(cells * shape[0] / longest)) + 1, max(2, round(cells * shape[1] / longest)) + 1)
    coarse = rng.normal(size=grid).astype(np.float32)
    # Cubic interpolation keeps about two thirds of the variance of the grid.
    return cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC) * 1.25


def _cut_part(rng: np.random.Generator, drawn: Bool[np.ndarray, "h w"], corner, shape, share: float) -> None:
    """Takes away what lies farthest in a random direction: legs, an armrest, the far end of a couch."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    field = smooth_field(rng, shape, cells=4)
    mask_kernels.cut(drawn, corner[0], corner[1], field, np.cos(angle), np.sin(angle), share)


def _leak(rng: np.random.Generator, drawn, mask, depth_m, corner, shape, radius_px: float) -> None:
    """Adds pixels beyond the boundary on surfaces at about the same depth."""
    boundary = mask_kernels.boundary_pixels(mask)
    if len(boundary) == 0:
        return
    row, column = divmod(int(boundary[int(rng.integers(len(boundary)))]), mask.shape[1])
    field = smooth_field(rng, shape, cells=5)
    mask_kernels.spill(drawn, depth_m, corner[0], corner[1], field, row, column, np.float32(radius_px))
