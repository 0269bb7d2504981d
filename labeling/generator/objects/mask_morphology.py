"""Masks grown and shrunk by whole pixels, as the thesis does it."""

import numpy as np
from jaxtyping import Bool, UInt8

SQUARE: UInt8[np.ndarray, "3 3"] = np.ones((3, 3), np.uint8)


def eroded(mask: Bool[np.ndarray, "h w"], times: int) -> Bool[np.ndarray, "h w"]:
    """The mask eroded by 3x3 pixels so many times; the mask itself where nothing would be left."""
    import cv2

    inner = cv2.erode(mask.astype(np.uint8), SQUARE, iterations=times) > 0 if times else mask
    return inner if inner.any() else mask


def dilated(mask: Bool[np.ndarray, "h w"], times: int) -> Bool[np.ndarray, "h w"]:
    """The mask dilated by 3x3 pixels so many times."""
    import cv2

    return cv2.dilate(mask.astype(np.uint8), SQUARE, iterations=times) > 0 if times else mask
