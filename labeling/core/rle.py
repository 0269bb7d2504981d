"""COCO's compressed run-length text, straight to masks and back.

Source: the COCO API's maskApi, ``rleFrString`` and ``rleToString``: runs of zeros and ones in turn, column by column;
every run from the fourth on as its difference from the run two before; in groups of 5 bits, sign-extended, each with a
sixth bit that says whether more follow, written as characters from ``0`` on.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool
from numba import njit


def decode_text(text: bytes, size: tuple[int, int]) -> Bool[np.ndarray, "h w"] | None:
    """The mask of a compressed RLE; None if the text is malformed or its runs do not fill the picture exactly.

    Args:
        text: the counts.
        size: picture height and width, both positive.
    """
    mask = np.zeros(size, np.bool_)
    return mask if _decode(np.frombuffer(text, np.uint8), mask) else None


def encode_text(mask: Bool[np.ndarray, "h w"]) -> tuple[str, int, tuple[int, int, int, int]]:
    """Compressed RLE, number of pixels and tightest box (left, top, width, height; zeros for an empty mask)."""
    mask = np.ascontiguousarray(mask, np.bool_)
    top, bottom, left, right = (int(side) for side in _bounds(mask))
    text, area = _encode(mask, top, bottom, left, right)
    return text.tobytes().decode("ascii"), int(area), (left, top, right - left, bottom - top)


@njit(cache=True, nogil=True)
def _decode(text, mask):  # pragma: no cover - compiled
    height, width = mask.shape
    place, end = np.int64(0), np.int64(height) * width
    before, last, number = np.int64(0), np.int64(0), 0
    position = 0
    while position < len(text):
        run, shift, more = np.int64(0), 0, True
        while more:
            if position >= len(text) or shift > 55:
                return False
            chunk = np.int64(text[position]) - 48
            if chunk < 0 or chunk > 63:
                return False
            run |= (chunk & 31) << shift
            more = chunk & 32 != 0
            position += 1
            shift += 5
            if not more and chunk & 16:
                run |= np.int64(-1) << shift
        if number > 2:
            run += before
        if run < 0 or run > end - place:
            return False
        if number % 2 == 1:
            x, y = place // height, place % height
            for _ in range(run):
                mask[y, x] = True
                y += 1
                if y == height:
                    y = 0
                    x += 1
        place += run
        before, last = last, run
        number += 1
    return place == end


@njit(cache=True, nogil=True)
def _bounds(mask):  # pragma: no cover - compiled
    """First and one past the last row and column of a mask; zeros if it is empty."""
    height, width = mask.shape
    top, bottom, left, right = height, 0, width, 0
    for y in range(height):
        first = 0
        while first < width and not mask[y, first]:
            first += 1
        if first == width:
            continue
        last = width - 1
        while not mask[y, last]:
            last -= 1
        top, bottom = min(top, y), y + 1
        left, right = min(left, first), max(right, last + 1)
    if bottom == 0:
        return 0, 0, 0, 0
    return top, bottom, left, right


@njit(cache=True, nogil=True)
def _encode(mask, top, bottom, left, right):  # pragma: no cover - compiled
    height, width = mask.shape
    # Every column has at most half as many runs of ones as rows, and at the ends runs of zeros.
    runs = np.empty((right - left) * (bottom - top + 1) + 2, np.int64)
    count, area, start, inside = 0, 0, np.int64(0), False
    for x in range(left, right):
        for y in range(top, bottom):
            if mask[y, x] != inside:
                place = np.int64(x) * height + y
                runs[count] = place - start
                count, start, inside = count + 1, place, not inside
            area += mask[y, x]
        if inside and (bottom < height or top > 0):
            place = np.int64(x) * height + bottom
            runs[count] = place - start
            count, start, inside = count + 1, place, False
    if inside and right < width:
        runs[count] = np.int64(right) * height - start
        count, start = count + 1, np.int64(right) * height
    if start < np.int64(height) * width:
        runs[count] = np.int64(height) * width - start
        count += 1
    text = np.empty(13 * count, np.uint8)
    length = 0
    for i in range(count):
        value = runs[i] - (runs[i - 2] if i > 2 else 0)
        more = True
        while more:
            chunk = value & 31
            value >>= 5
            more = value != (-1 if chunk & 16 else 0)
            text[length] = (chunk | (32 if more else 0)) + 48
            length += 1
    return text[:length].copy(), area


def encode_mask(mask: Bool[np.ndarray, "h w"]) -> dict:
    """COCO compressed RLE of a mask, ready for JSON: ``{"size": [height, width], "counts": text}``."""
    from labeling.core.rle import encode_text

    return {"size": [int(side) for side in mask.shape], "counts": encode_text(mask)[0]}


def decode_mask(rle: Any) -> Bool[np.ndarray, "h w"]:
    """The mask of a COCO RLE, compressed (text) or uncompressed (list of run lengths).

    Raises:
        ValueError: if the RLE is malformed or its runs do not fill its size.
    """
    if not isinstance(rle, dict) or "size" not in rle or "counts" not in rle:
        raise ValueError("an RLE is an object with 'size' and 'counts'")
    size = rle["size"]
    if not (isinstance(size, list | tuple) and len(size) == 2 and all(_is_whole(s) and s > 0 for s in size)):
        raise ValueError(f"RLE size must be [height, width] in pixels, not {size!r}")
    counts = rle["counts"]
    if isinstance(counts, list):
        if not all(_is_whole(run) and run >= 0 for run in counts) or sum(counts) != size[0] * size[1]:
            raise ValueError(f"RLE runs do not fill {size[0]}x{size[1]} pixels")
        values = np.arange(len(counts)) % 2 == 1
        return np.repeat(values, counts).reshape(size[1], size[0]).T
    if not isinstance(counts, str | bytes):
        raise ValueError(f"RLE counts must be text or a list of run lengths, not {type(counts).__name__}")
    text = counts.decode("ascii") if isinstance(counts, bytes) else counts
    return _decode_text(text, (size[0], size[1]))


def _is_whole(value: object) -> bool:
    """Whether this is a whole number; true and false are none, though Python counts them as such."""
    return isinstance(value, int) and not isinstance(value, bool)


def _decode_text(text: str, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """Decodes compressed RLE text; refuses runs that do not fill the picture, which decoders pad or cut silently."""
    from labeling.core.rle import decode_text

    mask = decode_text(text.encode("ascii", "replace"), size)
    if mask is None:
        raise ValueError(f"RLE runs cover {_total_run_length(text)} pixels, but its size is {size[0]}x{size[1]}")
    return mask


def _total_run_length(text: str) -> int:
    """Sum of the runs of a compressed RLE: 5-bit groups, sign-extended, every run from the third on a difference
    from the run two before. Source: the COCO API's maskApi, ``rleFrString``.
    """
    runs: list[int] = []
    position = 0
    while position < len(text):
        value, shift, more = 0, 0, True
        while more:
            if position >= len(text):
                raise ValueError("RLE counts end in the middle of a run")
            chunk = ord(text[position]) - 48
            if not 0 <= chunk < 64:
                raise ValueError(f"RLE counts hold a character outside the code: {text[position]!r}")
            if shift > 60:
                raise ValueError("RLE counts hold a run of more than 60 bits")
            value |= (chunk & 0x1F) << shift
            more = bool(chunk & 0x20)
            position += 1
            shift += 5
            if not more and chunk & 0x10:
                value |= -1 << shift
        if len(runs) > 2:
            value += runs[-2]
        if value < 0:
            raise ValueError("RLE counts hold a negative run")
        runs.append(value)
    return sum(runs)
