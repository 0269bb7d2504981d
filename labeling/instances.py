"""What is known about objects in views: detections, ground truth, pseudo-labels, 3-D boxes, and masks as COCO RLE."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

CONFIDENT = 0.9
"""Detections at least this confident are trusted as sources of labels, unless configured. Source: thesis A.2.2."""


@dataclass(frozen=True)
class Box3d:
    """An oriented box in the world."""

    centre_m: Float[np.ndarray, "3"]
    extent_m: Float[np.ndarray, "3"]
    """Full edge lengths along the box's own axes."""
    rotation: Float[np.ndarray, "3 3"]
    """Columns are the box's axes in the world."""

    def corners(self) -> Float[np.ndarray, "8 3"]:
        """The eight corners in the world, metres."""
        signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij"), axis=-1).reshape(8, 3)
        return self.centre_m + (signs * self.extent_m) @ self.rotation.T


@dataclass(frozen=True, eq=False)
class Detection:
    """What a detector says about one object in one view. Equal if all fields are, the mask pixel by pixel."""

    view_index: int
    category: str
    confidence: float
    """In [0, 1]."""
    mask: Bool[np.ndarray, "h w"]
    exact: bool = False
    """Drawn by a person, so that its outline needs no doubt: the mask is not eroded."""

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Detection)
            and (self.view_index, self.category, self.confidence, self.exact)
            == (other.view_index, other.category, other.confidence, other.exact)
            and np.array_equal(self.mask, other.mask)
        )


@dataclass(frozen=True)
class GroundTruth:
    """What the simulator (or an annotator) knows about one object in one view."""

    view_index: int
    instance_id: int
    """Identifies the object across the views of an episode."""
    category: str
    modal: Bool[np.ndarray, "h w"]
    """The visible part."""
    amodal: Bool[np.ndarray, "h w"] | None = None
    """The whole object, as if nothing stood before it; None where unknown."""
    box_3d: Box3d | None = None
    ignore: bool = False
    """Neither rewarded nor punished in evaluation (COCO's iscrowd), such as a sliver nobody would annotate."""


@dataclass(frozen=True)
class PseudoLabel:
    """What the label generator says about one object in one view."""

    view_index: int
    instance_id: int
    """Identifies the object across the views of an episode."""
    category: str
    confidence: float
    """In [0, 1]."""
    modal: Bool[np.ndarray, "h w"]
    """May be empty where only the amodal mask has pixels (the object is hidden in this view)."""
    amodal: Bool[np.ndarray, "h w"]
    source_view_index: int
    """The view of the confident detection this label stems from."""
    source_confidence: float


def box_xywh(mask: Bool[np.ndarray, "h w"]) -> tuple[float, float, float, float]:
    """Tightest box around a mask as COCO writes it: left, top, width, height in pixels; zeros for an empty mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return (0.0, 0.0, 0.0, 0.0)
    return (
        float(columns[0]),
        float(rows[0]),
        float(columns[-1] - columns[0] + 1),
        float(rows[-1] - rows[0] + 1),
    )


def mask_iou(a: Bool[np.ndarray, "h w"], b: Bool[np.ndarray, "h w"]) -> float:
    """Intersection over union of two masks; 0 if both are empty."""
    union = np.count_nonzero(a | b)
    return np.count_nonzero(a & b) / union if union else 0.0


def encode_mask(mask: Bool[np.ndarray, "h w"]) -> dict:
    """COCO compressed RLE of a mask, ready for JSON: ``{"size": [height, width], "counts": text}``."""
    from labeling.rle_codec import encode_text

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


def fill_polygons(polygons: Any, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """The mask of COCO polygons: the union of their insides, filled as COCO's own tools do.

    Args:
        polygons: lists of ``x1 y1 x2 y2 ...`` in pixels, where the left edge of the picture is at x = 0.
        size: height and width of the picture.

    Raises:
        ValueError: if a polygon has fewer than three corners, or corners far outside the picture.
    """
    from hotcoco import mask as coco_mask

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


def _is_whole(value: object) -> bool:
    """Whether this is a whole number; true and false are none, though Python counts them as such."""
    return isinstance(value, int) and not isinstance(value, bool)


def _decode_text(text: str, size: tuple[int, int]) -> Bool[np.ndarray, "h w"]:
    """Decodes compressed RLE text; refuses runs that do not fill the picture, which decoders pad or cut silently."""
    from labeling.rle_codec import decode_text

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
