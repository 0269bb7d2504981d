"""Views of an atlas as compressed bytes: lossless except for depth, which is rounded to a unit of length."""

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
"""Compression level of zlib."""
FARTHEST = np.iinfo(np.uint16).max


@dataclass(frozen=True)
class StoredView:
    """What an atlas holds of one pose."""

    depth_m: Float32[np.ndarray, "h w"]
    """z-depth of the observed picture, 0 = no return."""
    geom_id: Int32[np.ndarray, "h w"]
    """MuJoCo's id of the geom at each pixel of the observed picture, -1 for none."""
    detector_depth_m: Float32[np.ndarray, "hd wd"]
    """z-depth of the picture that the detector looked at."""
    detections: tuple[Detection, ...]


def encode_depth(depth_m: Float[np.ndarray, "h w"], unit_m: float) -> bytes:
    """Depth rounded to units, as compressed differences along rows; at most 65,535 units."""
    levels = np.clip(np.rint(np.asarray(depth_m, float) / unit_m), 0, FARTHEST).astype(np.uint16)
    # 0 stands for no return, so returns are rounded to at least 1.
    levels[(depth_m > 0) & (levels == 0)] = 1
    return zlib.compress(_by_bytes(np.diff(levels, axis=1, prepend=np.uint16(0))), LEVEL)


def decode_depth(content: Buffer, size: tuple[int, int], unit_m: float) -> Float32[np.ndarray, "h w"]:
    """Depth of a picture of this size (height, width), from the bytes of ``encode_depth``."""
    depth_m = np.empty(size, np.float32)
    low, high = _bytes_of(content, size)
    sum_along_rows(low, high, np.float32(unit_m), depth_m)
    return depth_m


def encode_ids(geom_id: Int32[np.ndarray, "h w"]) -> bytes:
    """Geom ids from -1 to 65,534, as compressed differences along rows."""
    ids = (np.asarray(geom_id) + 1).astype(np.uint16)
    return zlib.compress(_by_bytes(np.diff(ids, axis=1, prepend=np.uint16(0))), LEVEL)


def decode_ids(content: Buffer, size: tuple[int, int]) -> Int32[np.ndarray, "h w"]:
    """Geom ids of a picture of this size (height, width), from the bytes of ``encode_ids``."""
    ids = np.empty(size, np.int32)
    low, high = _bytes_of(content, size)
    sum_along_rows(low, high, np.int32(1), ids)
    return ids - 1


def encode_detections(detections: Sequence[Detection]) -> bytes:
    """Category, confidence and mask (COCO RLE) of each, as JSON."""
    found = [[one.category, one.confidence, encode_mask(one.mask)["counts"]] for one in detections]
    return json.dumps(found).encode()


def decode_detections(content: Buffer, size: tuple[int, int], view_index: int = 0) -> tuple[Detection, ...]:
    """Detections from the bytes of ``encode_detections``.

    Args:
        content: the bytes.
        size: height and width of the picture, pixels.
        view_index: given to the detections.

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
    """All low bytes, then all high bytes: the latter are mostly equal, so they compress well."""
    return np.ascontiguousarray(numbers.view(np.uint8).reshape(*numbers.shape, 2).transpose(2, 0, 1)).tobytes()


def _bytes_of(content: Buffer, size: tuple[int, int]) -> UInt8[np.ndarray, "2 h w"]:
    """Low and high bytes, from compressed ``_by_bytes``."""
    # With the final size given zlib allocates the output once.
    return np.frombuffer(zlib.decompress(content, bufsize=2 * size[0] * size[1]), np.uint8).reshape(2, *size)
