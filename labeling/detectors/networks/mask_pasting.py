"""From the coarse mask of a box to the mask of a picture."""

import cv2
import numpy as np
from jaxtyping import Bool, Float32

MASK_THRESHOLD = 0.5


def paste_mask(
    probability: Float32[np.ndarray, "m m"], box_xyxy: Float32[np.ndarray, "4"], size: tuple[int, int]
) -> Bool[np.ndarray, "h w"]:
    """The mask of a picture from the probabilities in the cells of a box: bilinear, only inside the box.

    Args:
        probability: of each cell of a grid over the box.
        box_xyxy: in pixels.
        size: height and width of the picture.
    """
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
