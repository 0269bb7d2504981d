"""The ways in which a segmentation network's masks are wrong: wobbly rims, leaks into neighbours, missing parts."""

import cv2
import numpy as np
from jaxtyping import Bool, Float

Window = tuple[slice, slice]


def corrupt_mask(
    rng: np.random.Generator, mask: Bool[np.ndarray, "h w"], depth_m: Float[np.ndarray, "h w"], error: float
) -> Bool[np.ndarray, "h w"]:
    """A mask such as a network would have drawn for what ``mask`` shows.

    Args:
        rng: decides what goes wrong.
        mask: the true modal mask, not empty.
        depth_m: z-depth of the view; leaks flow to where depth is alike.
        error: from 0 (a rim of about one pixel) to 1 (about half of the object missing or as much added).

    Returns:
        The mask; may be empty.
    """
    area_px = np.count_nonzero(mask)
    size_px = float(np.sqrt(area_px))
    window = _window(mask, margin_px=int(np.ceil(2.0 + 0.4 * size_px)))
    true, depth = mask[window], depth_m[window]
    inside_px = cv2.distanceTransform(true.astype(np.uint8), cv2.DIST_L2, 3)
    outside_px = cv2.distanceTransform((~true).astype(np.uint8), cv2.DIST_L2, 3)
    signed_px = np.where(true, inside_px - 0.5, 0.5 - outside_px)
    wobble_px = smooth_field(rng, true.shape, cells=5) * (0.35 + (0.015 + 0.11 * error) * size_px)
    bias_px = rng.normal(0.0, 0.02 + 0.05 * error) * size_px
    drawn = signed_px + wobble_px + bias_px > 0.0
    # Networks respect depth and colour edges better than a rim of noise does: far-off background rarely joins.
    foreign = ~true & (np.abs(depth - _median(depth[true])) > 0.75)
    drawn &= ~foreign | (signed_px > -1.0 - 0.04 * size_px)
    if rng.random() < 0.1 + 0.6 * error:
        drawn = _cut_part(rng, drawn, share=float(rng.uniform(0.05, 0.15 + 0.45 * error)))
    if rng.random() < 0.1 + 0.6 * error:
        drawn = _leak(rng, drawn, true, depth, size_px * float(rng.uniform(0.15, 0.3 + 0.5 * error)))
    result = np.zeros(mask.shape, bool)
    result[window] = drawn
    return result


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
    rows, columns = np.ogrid[:height_px, :width_px]
    distance = np.hypot((rows - y) / radii_px[0], (columns - x) / radii_px[1])
    blob = distance < 1.0 + 0.25 * smooth_field(rng, depth_m.shape, cells=6)
    return blob & (depth_m > 0.0) & (np.abs(depth_m - depth_m[y, x]) < 0.4)


def smooth_field(rng: np.random.Generator, shape: tuple[int, int], cells: int) -> Float[np.ndarray, "h w"]:
    """Gaussian noise of about unit variance that varies over ``1/cells`` of the longer side."""
    longest = max(shape)
    grid = (max(2, round(cells * shape[0] / longest)) + 1, max(2, round(cells * shape[1] / longest)) + 1)
    coarse = rng.normal(size=grid).astype(np.float32)
    # Cubic interpolation keeps about two thirds of the variance of the grid.
    return cv2.resize(coarse, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC) * 1.25


def _median(values: Float[np.ndarray, "n"]) -> np.floating:
    """``np.median`` of finite values, without the checks that take most of its time."""
    half = len(values) // 2
    if len(values) % 2:
        return np.partition(values, half)[half]
    return np.partition(values, (half - 1, half))[half - 1 : half + 1].mean()


def _window(mask: Bool[np.ndarray, "h w"], margin_px: int) -> Window:
    left, top, width, height = cv2.boundingRect(mask.view(np.uint8))
    return (
        slice(max(0, top - margin_px), top + height + margin_px),
        slice(max(0, left - margin_px), left + width + margin_px),
    )


def _cut_part(rng: np.random.Generator, drawn: Bool[np.ndarray, "h w"], share: float) -> Bool[np.ndarray, "h w"]:
    """Takes away what lies farthest in a random direction: legs, an armrest, the far end of a couch."""
    y, x = np.nonzero(drawn)
    if len(x) == 0:
        return drawn
    angle = rng.uniform(0.0, 2.0 * np.pi)
    along = x * np.cos(angle) + y * np.sin(angle)
    wavy = along + 0.1 * np.ptp(along) * smooth_field(rng, drawn.shape, cells=4)[y, x]
    limit = np.quantile(wavy, 1.0 - share)
    result = drawn.copy()
    result[y[wavy > limit], x[wavy > limit]] = False
    return result


def _leak(rng, drawn, true, depth, radius_px: float) -> Bool[np.ndarray, "h w"]:
    """Spills over the rim into surfaces at about the same depth."""
    rim_y, rim_x = np.nonzero(true & ~cv2.erode(true.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool))
    if len(rim_x) == 0:
        return drawn
    start = int(rng.integers(len(rim_x)))
    y, x = rim_y[start], rim_x[start]
    rows, columns = np.ogrid[: drawn.shape[0], : drawn.shape[1]]
    near = np.hypot(rows - y, columns - x) < radius_px * (1.0 + 0.3 * smooth_field(rng, drawn.shape, cells=5))
    return drawn | (near & (depth > 0.0) & (np.abs(depth - depth[y, x]) < 0.25))
