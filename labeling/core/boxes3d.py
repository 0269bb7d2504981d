"""Gravity-aligned oriented boxes around segments of a cloud."""

import numpy as np
from jaxtyping import Float
from numba import njit

from labeling.core.types import Box3d

ANGLES = 90
"""Directions tried in a quarter turn, besides those of the hull's edges."""
NEAR_SIDE = 0.05
"""Points so near a side, as a share of the root of the smallest rectangle's area, lie on it."""
SMALLNESS = 6.0
"""Power of a rectangle's smallness in its score. With 4 or 8 mean IoU on training scenes was within .02 of that with 6,
in every category."""


def fit_box(points: Float[np.ndarray, "n 3"], trim: float = 0.01, margin_m: float = 0.0) -> Box3d | None:
    """The upright box of a segment: the rectangle around its footprint whose sides points lie on, and its extent
    along +Z.

    A rectangle's score is how near to its sides points lie, times its smallness to a power. The smallest rectangle
    alone will not do: the hull of an object that two sides were seen of is a triangle, and the rectangle on its longest
    side, the diagonal of the object, is no larger than the one on its sides.

    Args:
        points: world points of one object, metres.
        trim: share of points that may stick out on each side: outliers must not grow the box.
        margin_m: added to every extent (a voxel, where points are voxel centres).

    Returns:
        The box, its longer horizontal side first and its third axis up; None without points.

    Source: Zhang, Xu, Dong, Dolan 2017, "Efficient L-Shape Fitting for Vehicle Detection Using Laser Scanners",
    algorithm 4 (closeness); the power of smallness is ours.
    """
    if len(points) == 0:
        return None
    points = np.ascontiguousarray(points, float)
    low, high = np.quantile(points, [trim, 1 - trim], axis=0)
    footprint = _within(points, low, high)
    best = _best_rectangle(footprint, _hull(footprint))
    (bottom, top), (angle, low, high) = (low[2], high[2]), best
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    sides, middle = high - low, turn @ (0.5 * (low + high))
    if sides[1] > sides[0]:
        turn, sides = np.stack([turn[:, 1], -turn[:, 0]], axis=1), sides[::-1]
    rotation = np.eye(3)
    rotation[:2, :2] = turn
    extent = np.array([sides[0], sides[1], top - bottom]) + margin_m
    return Box3d(np.array([*middle, 0.5 * (bottom + top)]), extent, rotation)


@njit(cache=True, nogil=True)
def _within(points, low, high):  # pragma: no cover - compiled
    """Horizontal places (m, 2) of those ``points`` (n, 3) float64 that lie inside the per-axis quantiles ``low`` and
    ``high`` (3,), so that single outliers do not stretch the footprint's hull; of all if none do.
    """
    kept, count = np.empty((len(points), 2)), 0
    for p in range(len(points)):
        inside = True
        for axis in range(3):
            inside &= (points[p, axis] >= low[axis] - 1e-9) & (points[p, axis] <= high[axis] + 1e-9)
        if inside:
            kept[count, 0], kept[count, 1] = points[p, 0], points[p, 1]
            count += 1
    return kept[:count] if count > 0 else points[:, :2].copy()


def _hull(footprint) -> np.ndarray:
    """Corners of the convex hull, in order."""
    import cv2

    order = cv2.convexHull(footprint.astype(np.float32), returnPoints=False)
    return footprint[np.ravel(order)]


def _best_rectangle(footprint, hull):
    """Angle and bounds (2,) of the rectangle with the highest score."""
    angles = np.concatenate([_edge_angles(hull), np.arange(ANGLES) * (np.pi / 2 / ANGLES)])
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    turned = np.stack([cos * hull[:, 0] + sin * hull[:, 1], cos * hull[:, 1] - sin * hull[:, 0]], axis=2)
    low, high = turned.min(axis=1), turned.max(axis=1)
    areas = np.prod(high - low, axis=1)
    least = max(float(areas.min()), 1e-12)
    smallness = (least / np.maximum(areas, least)) ** SMALLNESS
    best, highest = 0, -1.0
    for number in np.argsort(-smallness, kind="stable"):
        if smallness[number] <= highest:  # closeness is at most 1
            break
        score = smallness[number] * _closeness(
            footprint, angles[number], low[number], high[number], NEAR_SIDE * np.sqrt(least)
        )
        if score > highest:
            best, highest = number, score
    return float(angles[best]), low[best], high[best]


@njit(cache=True, nogil=True)
def _closeness(footprint, angle, low, high, near_m):  # pragma: no cover - compiled
    """Mean over the points (n, 2) of ``near_m`` over the distance to the nearest side of the rectangle with the bounds
    ``low`` and ``high`` (2,) in axes turned by ``angle``, at most 1.
    """
    cos, sin, total = np.cos(angle), np.sin(angle), 0.0
    for p in range(len(footprint)):
        x = cos * footprint[p, 0] + sin * footprint[p, 1]
        y = cos * footprint[p, 1] - sin * footprint[p, 0]
        distance = min(min(x - low[0], high[0] - x), min(y - low[1], high[1] - y))
        total += near_m / max(distance, near_m)
    return total / len(footprint)


def _edge_angles(hull) -> np.ndarray:
    """Directions of the hull's edges: one side of the smallest rectangle lies on one. Source: Freeman, Shapira 1975."""
    edges = np.roll(hull, -1, axis=0) - hull
    edges = edges[np.linalg.norm(edges, axis=1) > 1e-9]
    if len(edges) == 0:
        return np.zeros(1)
    return np.unique(np.mod(np.arctan2(edges[:, 1], edges[:, 0]), np.pi / 2))
