"""Outlines of masks: polygons along the edges of pixels, for formats that know no masks."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree


@dataclass(frozen=True)
class Outline:
    """One closed polygon of a mask."""

    points_px: Float[np.ndarray, "n 2"]
    """x and y of its corners, at least three; the left and the upper edge of the picture lie at 0."""
    parent: int | None
    """Of a hole: the index of the outline around it; None of a piece."""


def outlines(mask: Bool[np.ndarray, "h w"], holes: bool = True) -> list[Outline]:
    """The outlines of all pieces of a mask and of their holes.

    They run a quarter of a pixel inside the edges of pixels, holes a quarter outside, so that the pixels whose centres
    lie within an odd number of them are those of the mask.

    Args:
        mask: any mask; an empty one has no outline.
        holes: whether holes are told; without them they are filled.
    """
    return [Outline(_placed(_corners(contour)), parent) for contour, parent in _traced(mask, holes)]


def joined_outline(mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "n 2"]:
    """One polygon around all pieces of a mask with at least one pixel, holes filled; as ``Outline.points_px``.

    Pieces are joined where they are nearest to each other, by a bridge there and back.
    """
    pieces = sorted((contour for contour, _ in _traced(mask, holes=False)), key=len, reverse=True)
    joined = pieces[0]
    for piece in pieces[1:]:
        apart, nearest = cKDTree(joined).query(piece)
        there = int(apart.argmin())
        here, around = int(nearest[there]), np.roll(piece, -there, axis=0)
        joined = np.concatenate([joined[: here + 1], around, around[:1], joined[here:]])
    return _placed(_corners(joined))


def _traced(mask: Bool[np.ndarray, "h w"], holes: bool) -> list[tuple[Int[np.ndarray, "n 2"], int | None]]:
    """Every pixel along each outline of a mask drawn twice as large, and of a hole the index of what is around it."""
    # Twice as large, so that the outline runs along the edges of pixels and not through their centres.
    large = np.kron(mask.astype(np.uint8), np.ones((2, 2), np.uint8))
    mode = cv2.RETR_CCOMP if holes else cv2.RETR_EXTERNAL
    contours, hierarchy = cv2.findContours(large, mode, cv2.CHAIN_APPROX_NONE)
    parents = np.zeros(0, int) if hierarchy is None else hierarchy.reshape(-1, 4)[:, 3]
    return [
        (contour.reshape(-1, 2), None if parent < 0 else int(parent))
        for contour, parent in zip(contours, parents, strict=True)
    ]


def _placed(contour: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Pixels of the mask drawn twice as large, in pixels of the mask."""
    return contour / 2 + 0.25


def _corners(contour: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, "k 2"]:
    """A contour without what lies on a straight line between its neighbours."""
    step = np.roll(contour, -1, axis=0) - contour
    turns = np.any(step != np.roll(step, 1, axis=0), axis=1)
    return contour[turns] if turns.sum() >= 3 else contour
