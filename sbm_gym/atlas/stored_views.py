"""Views of an atlas as bytes: lossless but for depth, which is rounded to a unit of length."""

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8, UInt16

from labeling.core.rle import encode_mask
from labeling.core.types import Detection
from sbm_gym.atlas.decoding_kernels import draw_masks, sum_along_rows

Buffer = bytes | memoryview
LEVEL = 6
"""Of zlib."""
FARTHEST = np.iinfo(np.uint16).max


@dataclass(frozen=True)
class StoredView:
    """What is known of one pose."""

    depth_m: Float32[np.ndarray, "h w"]
    """z-depth of the observed picture, 0 = no return."""
    geom_id: Int32[np.ndarray, "h w"]
    """What its pixels show, -1 for nothing."""
    detector_depth_m: Float32[np.ndarray, "hd wd"]
    """z-depth of the picture that the detector looked at."""
    detections: tuple[Detection, ...]


def encode_depth(depth_m: Float[np.ndarray, "h w"], unit_m: float) -> bytes:
    """Depth in whole units; differences along rows compress well. What is farther than 65,535 units counts as that."""
    levels = np.clip(np.rint(np.asarray(depth_m, float) / unit_m), 0, FARTHEST).astype(np.uint16)
    # A return is never rounded to 0, which stands for none.
    levels[(depth_m > 0) & (levels == 0)] = 1
    return zlib.compress(_by_bytes(np.diff(levels, axis=1, prepend=np.uint16(0))), LEVEL)


def decode_depth(content: Buffer, size: tuple[int, int], unit_m: float) -> Float32[np.ndarray, "h w"]:
    """What ``encode_depth`` made of a depth image of this size."""
    depth_m = np.empty(size, np.float32)
    low, high = _bytes_of(content, size)
    sum_along_rows(low, high, np.float32(unit_m), depth_m)
    return depth_m


def encode_ids(geom_id: Int32[np.ndarray, "h w"]) -> bytes:
    """Ids from -1 to 65,534."""
    ids = (np.asarray(geom_id) + 1).astype(np.uint16)
    return zlib.compress(_by_bytes(np.diff(ids, axis=1, prepend=np.uint16(0))), LEVEL)


def decode_ids(content: Buffer, size: tuple[int, int]) -> Int32[np.ndarray, "h w"]:
    """What ``encode_ids`` made of ids of this size."""
    ids = np.empty(size, np.int32)
    low, high = _bytes_of(content, size)
    sum_along_rows(low, high, np.int32(1), ids)
    return ids - 1


def encode_detections(detections: Sequence[Detection]) -> bytes:
    """Category, confidence and mask (COCO RLE) of each, as JSON."""
    found = [[one.category, one.confidence, encode_mask(one.mask)["counts"]] for one in detections]
    return json.dumps(found).encode()


def decode_detections(content: Buffer, size: tuple[int, int], view_index: int = 0) -> tuple[Detection, ...]:
    """What ``encode_detections`` made of detections in a picture of this size.

    Args:
        content: bytes.
        size: of the picture, pixels.
        view_index: that they are to have.

    Raises:
        ValueError: if a mask does not fill the picture.
    """
    found = json.loads(bytes(content))
    counts = [one[2].encode("ascii") for one in found]
    ends = np.cumsum([0, *map(len, counts)])
    masks = np.zeros((len(found), *size), bool)
    if not draw_masks(np.frombuffer(b"".join(counts), np.uint8), ends, masks):
        raise ValueError(f"a mask does not fill a picture of {size[0]}x{size[1]} pixels")
    return tuple(Detection(view_index, one[0], one[1], mask) for one, mask in zip(found, masks, strict=True))


def _by_bytes(numbers: UInt16[np.ndarray, "h w"]) -> bytes:
    """First the low bytes, then the high ones, which are mostly alike."""
    return np.ascontiguousarray(numbers.view(np.uint8).reshape(*numbers.shape, 2).transpose(2, 0, 1)).tobytes()


def _bytes_of(content: Buffer, size: tuple[int, int]) -> UInt8[np.ndarray, "2 h w"]:
    """Low and high bytes of compressed numbers."""
    # Told how long it gets, zlib need not move it time and again.
    return np.frombuffer(zlib.decompress(content, bufsize=2 * size[0] * size[1]), np.uint8).reshape(2, *size)
