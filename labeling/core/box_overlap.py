"""Exact overlap of oriented boxes, in space and in bird's-eye view."""

import numpy as np
from jaxtyping import Float
from numba import njit

from labeling.core.types import Box3d

_FACES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
"""Corners of ``Box3d.corners()`` around each face, counter-clockwise seen from outside."""
_NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], float)
"""Outward normals of these faces, in the box's own axes."""
_TOLERANCE = 1e-9
"""Distances below this share of the boxes' size are taken for 0."""
_MOST_CORNERS = 12
"""A rectangle that six planes have cut has at most ten."""


def box_iou_3d(a: Box3d, b: Box3d) -> float:
    """Intersection over union of the volumes of two boxes in any orientation; 0 if one has no volume.

    Example:
        >>> unit = Box3d(np.zeros(3), np.ones(3), np.eye(3))
        >>> round(box_iou_3d(unit, Box3d(np.array([0.5, 0, 0]), np.ones(3), np.eye(3))), 6)
        0.333333
    """
    shared = intersection_volume(a, b)
    union = float(np.prod(a.extent_m)) + float(np.prod(b.extent_m)) - shared
    return min(1.0, shared / union) if union > 0 else 0.0


def box_iou_bev(a: Box3d, b: Box3d) -> float:
    """Intersection over union of two upright boxes in bird's-eye view: of their footprints, whatever their heights."""
    return box_iou_3d(_flat(a), _flat(b))


def intersection_volume(a: Box3d, b: Box3d) -> float:
    """Volume of the intersection of two boxes in any orientation, cubic metres.

    Its surface is the part of a's faces that lies in b and the part of b's faces that lies in a; its volume follows by
    Gauss's theorem. A face that both have in common counts once.
    """
    if not (np.all(a.extent_m > 0) and np.all(b.extent_m > 0)):
        return 0.0
    reach = 0.5 * float(np.linalg.norm(a.extent_m) + np.linalg.norm(b.extent_m))
    if np.linalg.norm(a.centre_m - b.centre_m) >= reach:
        return 0.0
    middle = 0.5 * (a.centre_m + b.centre_m)
    faces = [np.ascontiguousarray((box.corners() - middle)[_FACES]) for box in (a, b)]
    planes = [_planes(box, middle) for box in (a, b)]
    tolerance = _TOLERANCE * reach
    first = _six_volumes(faces[0], *planes[1], tolerance)
    second = _six_volumes(faces[1], *planes[0], -tolerance)
    return max(0.0, (first + second) / 6.0)


def _planes(box: Box3d, middle: np.ndarray) -> tuple[Float[np.ndarray, "6 3"], Float[np.ndarray, "6"]]:
    """Outward normals of a box's faces, and how far from ``middle`` these lie along them."""
    normals = _NORMALS @ np.asarray(box.rotation, float).T
    return normals, normals @ (box.centre_m - middle) + 0.5 * np.repeat(np.asarray(box.extent_m, float), 2)


def _flat(box: Box3d) -> Box3d:
    angle = np.arctan2(box.rotation[1, 0], box.rotation[0, 0])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    return Box3d(np.array([*box.centre_m[:2], 0.0]), np.array([*box.extent_m[:2], 1.0]), turn)


@njit(cache=True)
def _six_volumes(faces, normals, offsets, slack):  # pragma: no cover - compiled
    """Six times the signed volume of the cones from the origin to a box's faces, clipped to the inside of another box.

    Args:
        faces: (6, 4, 3) float64, the corners of each face, counter-clockwise seen from outside, metres.
        normals: (6, 3) float64, outward unit normals of the other box's faces.
        offsets: (6,) float64, distances of these faces from the origin along their normals, metres.
        slack: how far outside a plane a point still counts as inside, metres; may be negative.

    Source: Sutherland, Hodgman 1974, for the clipping.
    """
    total = 0.0
    polygon, cut = np.empty((_MOST_CORNERS, 3)), np.empty((_MOST_CORNERS, 3))
    for face in faces:
        count = 4
        polygon[:4] = face
        for plane in range(len(normals)):
            kept = 0
            for here in range(count):
                there = (here + 1) % count
                d_here = np.dot(normals[plane], polygon[here]) - offsets[plane] - slack
                d_there = np.dot(normals[plane], polygon[there]) - offsets[plane] - slack
                if d_here <= 0.0:
                    cut[kept] = polygon[here]
                    kept += 1
                if d_here * d_there < 0.0:
                    cut[kept] = polygon[here] + (polygon[there] - polygon[here]) * (d_here / (d_here - d_there))
                    kept += 1
            polygon, cut, count = cut, polygon, kept
        for corner in range(1, count - 1):
            total += np.dot(polygon[0], np.cross(polygon[corner], polygon[corner + 1]))
    return total
