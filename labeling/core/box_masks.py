"""Masks for detectors that only give boxes: GrabCut inside the box, seeded by depth."""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

MARGIN = 0.15
"""Width of the surroundings that GrabCut learns the background from, as a share of the box."""
ITERATIONS = 3
NEAR = 0.1
"""Quantile of the depth in a box that is taken to be the object's front."""
FOCAL_SHARE = 0.8
"""Focal length as a share of the longer side of the picture, where cameras are not known: about 64 degrees."""
MIN_SHARE = 0.05
"""A mask that fills less of its box than this has failed."""


def mask_in_box(
    rgb: UInt8[np.ndarray, "h w 3"], box_xyxy: Float32[np.ndarray, "4"], depth_m: Float32[np.ndarray, "h w"] | None
) -> Bool[np.ndarray, "h w"]:
    """Outlines the object that a box was drawn around.

    What lies further behind the front of the box's content than an object of its size is deep is probably background,
    the rest of the box probably the object, and what surrounds the box is background; colour decides from there. An
    object is taken to be as deep as its box is wide or high. (The depth of the middle of the box tells less: chairs and
    tables are open there.) Source: GrabCut, Rother et al. 2004.

    Args:
        rgb: the picture.
        box_xyxy: left, top, right, bottom in pixels.
        depth_m: z-depth, 0 = no return; None if unknown: then colour decides alone.

    Returns:
        The mask, inside the box; where nothing can be told apart, all of the box. Empty if the box is.
    """
    height, width = rgb.shape[:2]
    left, top, right, bottom = np.clip(np.rint(box_xyxy), 0, [width, height] * 2).astype(int).tolist()
    mask = np.zeros((height, width), bool)
    if right - left < 1 or bottom - top < 1:
        return mask
    seeds = np.full((height, width), cv2.GC_BGD, np.uint8)
    inside = (slice(top, bottom), slice(left, right))
    near = None if depth_m is None else _near(depth_m[inside], max(height, width))
    seeds[inside] = cv2.GC_PR_FGD if near is None else np.where(near, cv2.GC_PR_FGD, cv2.GC_PR_BGD)
    reach_x, reach_y = (max(2, round(MARGIN * side)) for side in (right - left, bottom - top))
    window = (
        slice(max(0, top - reach_y), min(height, bottom + reach_y)),
        slice(max(0, left - reach_x), min(width, right + reach_x)),
    )
    found = _grab_cut(rgb[window], seeds[window])
    if found is not None:
        mask[window] = found
        mask[seeds == cv2.GC_BGD] = False
    area = (right - left) * (bottom - top)
    if mask.sum() < MIN_SHARE * area:
        mask[inside] = True if near is None or near.sum() < MIN_SHARE * area else near
    return mask


def _near(depth_m: Float32[np.ndarray, "h w"], longer_px: int) -> Bool[np.ndarray, "h w"] | None:
    """Which pixels of a box are not too far to be of the object; None if the box has no depth."""
    there = depth_m[depth_m > 0]
    if len(there) == 0:
        return None
    front = float(np.quantile(there, NEAR))
    size_m = front * max(depth_m.shape) / (FOCAL_SHARE * longer_px)
    # Pixels without a return are 0: left to colour, from the object's side.
    return depth_m <= front + size_m


def _grab_cut(rgb: UInt8[np.ndarray, "h w 3"], seeds: UInt8[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"] | None:
    """The cut; None where one side has nothing to learn from."""
    foreground = (seeds == cv2.GC_PR_FGD) | (seeds == cv2.GC_FGD)
    if foreground.all() or not foreground.any():
        return None
    cv2.setRNGSeed(0)  # its clusters start at random
    seeds = seeds.copy()
    try:
        cv2.grabCut(
            np.ascontiguousarray(rgb[:, :, ::-1]),
            seeds,
            None,  # type: ignore[arg-type]
            np.zeros((1, 65)),
            np.zeros((1, 65)),
            ITERATIONS,
            cv2.GC_INIT_WITH_MASK,
        )
    except cv2.error:
        return None
    return (seeds == cv2.GC_PR_FGD) | (seeds == cv2.GC_FGD)
