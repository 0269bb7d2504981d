"""Masks for detectors that only give boxes: GrabCut inside the box, on colour and depth.

Every box costs the same few milliseconds: what it holds is cut at a bounded size.
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

MARGIN = 0.15
"""Width of the surroundings that GrabCut learns the background from, as a share of the box."""
ITERATIONS = 2
"""More make masks of plain things on plain ground no better and of shelves worse."""
CUT_PX = 112
"""Longer side of what is cut; larger boxes are reduced to it."""
NEAR = 0.25
"""Quantile of the depth in a box that is taken to be the object's front."""
FOCAL_SHARE = 0.8
"""Focal length as a share of the longer side of the picture, where cameras are not known: about 64 degrees."""
HOLE_PX = 9
"""Window in which pixels without a return take the mean depth of those that have one."""
CHROMA_GAIN = 4
"""Colours of things differ less than their lightness does."""
MIN_SHARE = 0.05
"""A mask that fills less of its box than this has failed."""


def mask_in_box(
    rgb: UInt8[np.ndarray, "h w 3"], box_xyxy: Float32[np.ndarray, "4"], depth_m: Float32[np.ndarray, "h w"] | None
) -> Bool[np.ndarray, "h w"]:
    """Outlines the object that a box was drawn around.

    What lies further behind the front of the box's content than an object of its size is deep is probably background,
    the rest of the box probably the object, and what surrounds the box is background; lightness, colour and depth
    decide from there. An object is taken to be as deep as its box is wide or high. (The depth of the middle of the box
    tells less: chairs and tables are open there.) Source: GrabCut, Rother et al. 2004.

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
    reach_x, reach_y = (max(2, round(MARGIN * side)) for side in (right - left, bottom - top))
    x, y = max(0, left - reach_x), max(0, top - reach_y)
    window = slice(y, min(height, bottom + reach_y)), slice(x, min(width, right + reach_x))
    whole = rgb[window].shape[1::-1]  # width and height, as cv2 counts
    size = tuple(max(4, round(side * min(1.0, CUT_PX / max(whole)))) for side in whole)
    columns, rows = (
        slice(round(start * n / of), max(round(start * n / of) + 1, round(stop * n / of)))
        for start, stop, n, of in zip((left - x, top - y), (right - x, bottom - y), size, whole, strict=True)
    )
    picture = cv2.resize(rgb[window], size, interpolation=cv2.INTER_AREA)
    seeds = np.full(size[::-1], cv2.GC_BGD, np.uint8)
    seeds[rows, columns] = cv2.GC_PR_FGD
    if depth_m is not None:
        depth = cv2.resize(depth_m[window], size, interpolation=cv2.INTER_NEAREST)
        share = max(right - left, bottom - top) / (FOCAL_SHARE * max(height, width))
        behind = _behind_front(depth, depth[rows, columns], share)
        if behind is not None:
            seeds[rows, columns][behind[rows, columns] > 1] = cv2.GC_PR_BGD
            picture = _lightness_chroma_depth(picture, behind)
    found = _grab_cut(picture, seeds)
    inside = (slice(top, bottom), slice(left, right))
    if found is not None:
        # Bilinear between the pixels of the reduced picture: edges at the picture's own resolution.
        mask[window] = cv2.resize(found.astype(np.float32), whole, interpolation=cv2.INTER_LINEAR) > 0.5
        outside = np.ones_like(mask)
        outside[inside] = False
        mask[outside] = False
    if mask.sum() < MIN_SHARE * (right - left) * (bottom - top):
        mask[inside] = True
    return mask


def _behind_front(
    depth_m: Float32[np.ndarray, "h w"], in_box: Float32[np.ndarray, "bh bw"], share: float
) -> Float32[np.ndarray, "h w"] | None:
    """How far pixels lie behind the front of what a box holds, in sizes of its object; None if the box has no depth.

    Pixels without a return take the depth of their neighbours; where these have none either, they lie in front: left to
    colour, from the object's side.
    """
    there = in_box[in_box > 0]
    if len(there) == 0:
        return None
    front = float(np.quantile(there, NEAR))
    returns = cv2.blur((depth_m > 0).astype(np.float32), (HOLE_PX, HOLE_PX))
    around = cv2.blur(depth_m, (HOLE_PX, HOLE_PX)) / np.maximum(returns, 1e-3)
    return ((np.where(depth_m > 0, depth_m, around) - front) / (front * share)).astype(np.float32)


def _lightness_chroma_depth(
    rgb: UInt8[np.ndarray, "h w 3"], behind: Float32[np.ndarray, "h w"]
) -> UInt8[np.ndarray, "h w 3"]:
    """The three channels that objects and what surrounds them are told apart by."""
    lightness, a, b = cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB))
    chroma = (a.astype(int) + b - 256) * CHROMA_GAIN + 128
    return np.dstack([lightness, chroma.clip(0, 255), (behind * 255).clip(0, 255)]).astype(np.uint8)


def _grab_cut(picture: UInt8[np.ndarray, "h w 3"], seeds: UInt8[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"] | None:
    """The cut; None where one side has nothing to learn from."""
    cv2.setRNGSeed(0)  # its clusters start at random
    models = np.zeros((1, 65)), np.zeros((1, 65))
    try:
        cv2.grabCut(picture, seeds, None, *models, ITERATIONS, cv2.GC_INIT_WITH_MASK)  # type: ignore[arg-type]
    except cv2.error:
        return None
    return (seeds == cv2.GC_PR_FGD) | (seeds == cv2.GC_FGD)
