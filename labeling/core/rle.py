"""Masks as COCO run-length encodings (RLE), by hotcoco's codec.

hotcoco refuses malformed counts and runs that leave the picture; runs that end before the picture does it fills up with
zeros, as the COCO API does. Here these are refused, too: they are the sign of a mask of another picture.
"""

from typing import Any

import numpy as np
from hotcoco import mask as coco_mask
from jaxtyping import Bool


def encode_mask(mask: Bool[np.ndarray, "h w"]) -> dict[str, Any]:
    """COCO compressed RLE of a mask, ready for JSON: ``{"size": [height, width], "counts": text}``.

    Example:
        >>> encode_mask(np.array([[False, True], [False, True]]))
        {'size': [2, 2], 'counts': '22'}
    """
    import cv2

    # hotcoco's masks are stored column by column, all others here row by row.
    columns: Any = cv2.transpose(np.ascontiguousarray(mask).view(np.uint8))
    rle = coco_mask.encode(columns.T)
    return {"size": [int(side) for side in mask.shape], "counts": rle["counts"].decode("ascii")}


def rle_area(rle: dict[str, Any]) -> int:
    """Number of pixels of a mask."""
    return int(coco_mask.area(rle))


def rle_box_xywh(rle: dict[str, Any]) -> list[float]:
    """Tightest box around a mask: left, top, width, height in pixels; zeros for an empty mask."""
    return coco_mask.to_bbox(rle).tolist()


def decode_mask(rle: Any) -> Bool[np.ndarray, "h w"]:
    """The mask of a COCO RLE, compressed (text) or uncompressed (list of run lengths).

    Raises:
        ValueError: if the RLE is malformed or its runs do not fill its size.

    Example:
        >>> decode_mask({"size": [2, 2], "counts": [2, 2]})
        array([[False,  True],
               [False,  True]])
    """
    import cv2

    check_rle(rle)
    height_px, width_px = rle["size"]
    if isinstance(rle["counts"], list):
        inside = np.arange(len(rle["counts"])) % 2 == 1
        return np.repeat(inside, rle["counts"]).reshape(width_px, height_px).T
    return cv2.transpose(coco_mask.decode(rle).T).view(np.bool_)


def check_rle(rle: Any) -> None:
    """Refuses what is no RLE of a picture of its size, without decoding it.

    Raises:
        ValueError: if the RLE is malformed or its runs do not fill its size.
    """
    if not isinstance(rle, dict) or "size" not in rle or "counts" not in rle:
        raise ValueError("an RLE is an object with 'size' and 'counts'")
    size, counts = rle["size"], rle["counts"]
    if not (isinstance(size, list | tuple) and len(size) == 2 and all(type(s) is int and s > 0 for s in size)):
        raise ValueError(f"RLE size must be [height, width] in pixels, not {size!r}")
    if isinstance(counts, list):
        if not all(type(run) is int and run >= 0 for run in counts) or sum(counts) != size[0] * size[1]:
            raise ValueError(f"RLE runs do not fill {size[0]}x{size[1]} pixels")
        return
    if not isinstance(counts, str | bytes):
        raise ValueError(f"RLE counts must be text or a list of run lengths, not {type(counts).__name__}")
    text = counts.decode("ascii") if isinstance(counts, bytes) else counts
    try:
        coco_mask.rle_from_string(text, *size)
    except OverflowError:
        raise ValueError(f"RLE size {list(size)} is no picture's") from None
    covered = _total_run_length(text.encode("ascii"))
    if covered != size[0] * size[1]:
        raise ValueError(f"RLE runs cover {covered} pixels, but its size is {size[0]}x{size[1]}")


def _total_run_length(counts: bytes) -> int:
    """Sum of the runs.

    Raises:
        ValueError: if the counts are not what the code allows.
    """
    from labeling.core.rle_kernels import sum_runs

    total, stray = sum_runs(np.frombuffer(counts, np.uint8))
    if stray > 0:
        raise ValueError(f"RLE counts hold a character outside the code: {chr(stray)!r}")
    if stray < 0:
        raise ValueError("RLE counts end in the middle of a run")
    return int(total)
