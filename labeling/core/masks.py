"""Masks, the boxes around them, and their overlap."""

import mmap
from contextlib import suppress
from typing import Any

import numpy as np
from hotcoco import mask as coco_mask
from jaxtyping import Bool, Float32

MASK_THRESHOLD = 0.5
"""Probability above which a pixel is taken to be the object's."""


def blank_masks(count: int, size: tuple[int, int]) -> Bool[np.ndarray, "n h w"]:
    """Empty masks that take memory only for the rows that are written to."""
    pages = mmap.mmap(-1, max(1, count * size[0] * size[1]), flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    with suppress(AttributeError, OSError):  # where there is no such advice, pages are small anyway
        pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, np.bool_, count * size[0] * size[1]).reshape(count, *size)


def box_xywh(mask: Bool[np.ndarray, "h w"]) -> tuple[float, float, float, float]:
    """Tightest box around a mask as COCO writes it: left, top, width, height in pixels; zeros for an empty mask."""
    import cv2

    left, top, width, height = cv2.boundingRect(mask.astype(np.uint8))
    return (float(left), float(top), float(width), float(height))


def box_xyxy(mask: Bool[np.ndarray, "h w"]) -> tuple[float, float, float, float]:
    """Tightest box around a mask: left, top, right, bottom in pixels; zeros for an empty mask."""
    left, top, width, height = box_xywh(mask)
    return (left, top, left + width, top + height)


def mask_iou(a: Bool[np.ndarray, "h w"], b: Bool[np.ndarray, "h w"]) -> float:
    """Intersection over union of two masks; 0 if both are empty."""
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def pairwise_mask_iou(a: Bool[np.ndarray, "n h w"], b: Bool[np.ndarray, "m h w"]) -> Float32[np.ndarray, "n m"]:
    """IoU of every mask with every other one; 0 where both are empty."""
    bits = [np.packbits(masks.reshape(len(masks), -1), axis=1) for masks in (a, b)]
    size_a, size_b = (np.bitwise_count(packed).sum(axis=1, dtype=np.int64) for packed in bits)
    shared = np.zeros((len(a), len(b)), np.int64)
    for row, one in enumerate(bits[0]):
        shared[row] = np.bitwise_count(bits[1] & one).sum(axis=1, dtype=np.int64)
    return (shared / np.maximum(size_a[:, None] + size_b - shared, 1)).astype(np.float32)


def fill_polygons(polygons: Any, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """The mask of COCO polygons: the union of their insides, filled as COCO's own tools do.

    Args:
        polygons: lists of ``x1 y1 x2 y2 ...`` in pixels, where the left edge of the picture is at x = 0.
        size: height and width of the picture.

    Raises:
        ValueError: if a polygon has fewer than three corners, or corners far outside the picture.
    """
    height_px, width_px = size
    if not isinstance(polygons, list) or not polygons:
        raise ValueError("a polygon mask is a list of lists x1 y1 x2 y2 ...")
    for polygon in polygons:
        if not isinstance(polygon, list) or not all(type(value) in (int, float) for value in polygon):
            raise ValueError("a polygon mask is a list of lists x1 y1 x2 y2 ... of numbers")
        if len(polygon) < 6 or len(polygon) % 2:
            raise ValueError(f"a polygon needs x and y of three corners or more, not {len(polygon)} numbers")
        # The time and memory of filling grow with the length of the outline.
        reach = 2 * max(size)
        if not all(-reach <= value <= reach for value in polygon):
            raise ValueError(f"a polygon has corners far outside the picture of {width_px}x{height_px} pixels")
    runs = coco_mask.merge(coco_mask.frPyObjects([[float(v) for v in polygon] for polygon in polygons], *size))
    return np.ascontiguousarray(coco_mask.decode(runs)).astype(bool)


def paste_mask(
    probability: Float32[np.ndarray, "m k"], box_xyxy: Float32[np.ndarray, "4"], size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The mask of a picture from the probabilities in the cells of a box: bilinear, only inside the box.

    Args:
        probability: of each cell of a grid over the box.
        box_xyxy: in pixels.
        size: height and width of the picture.
    """
    import cv2

    mask = np.zeros(size, bool)
    left, top = (max(0, int(np.floor(side))) for side in box_xyxy[:2])
    right, bottom = (min(limit, int(np.ceil(side))) for side, limit in zip(box_xyxy[2:], size[::-1], strict=True))
    if right <= left or bottom <= top:
        return mask
    cells = np.array(probability.shape[::-1], np.float64)
    step = cells / np.maximum(box_xyxy[2:] - box_xyxy[:2], 1e-3)
    # Pixel centres lie at half-integers here, as boxes count from the picture's edge; cv2's cells at integers.
    start = (np.array([left, top]) + 0.5 - box_xyxy[:2]) * step - 0.5
    warp = np.array([[step[0], 0, start[0]], [0, step[1], start[1]]])
    window = cv2.warpAffine(
        probability,
        warp,
        (right - left, bottom - top),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    mask[top:bottom, left:right] = window > MASK_THRESHOLD
    return mask
