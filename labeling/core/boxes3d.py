"""Gravity-aligned oriented boxes around segments of a cloud."""

import numpy as np
from jaxtyping import Float
from numba import njit

from labeling.core.types import Box3d


def fit_box(points: Float[np.ndarray, "n 3"], trim: float = 0.01, margin_m: float = 0.0) -> Box3d | None:
    """The upright box of a segment: smallest rectangle around its footprint, and its extent along +Z.

    Args:
        points: world points of one object, metres.
        trim: share of points that may stick out on each side: outliers must not grow the box.
        margin_m: added to every extent (a voxel, where points are voxel centres).

    Returns:
        The box, its longer horizontal side first and its third axis up; None without points.
    """
    if len(points) == 0:
        return None
    points = np.ascontiguousarray(points, float)
    low, high = np.quantile(points, [trim, 1 - trim], axis=0)
    corners = _hull(_within(points, low, high))
    best = min((_rectangle(corners, angle) for angle in _likely_angles(corners)), key=lambda r: r[0])
    (bottom, top), (_, angle, low, high) = (low[2], high[2]), best
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


def _edge_angles(hull) -> np.ndarray:
    """Directions of the hull's edges: one side of the smallest rectangle lies on one. Source: Freeman, Shapira 1975."""
    edges = np.roll(hull, -1, axis=0) - hull
    edges = edges[np.linalg.norm(edges, axis=1) > 1e-9]
    if len(edges) == 0:
        return np.zeros(1)
    return np.unique(np.mod(np.arctan2(edges[:, 1], edges[:, 0]), np.pi / 2))


def _likely_angles(hull) -> np.ndarray:
    """Those directions of the hull's edges along which the rectangle is the smallest, or next to it."""
    angles = _edge_angles(hull)
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y = hull[:, 0], hull[:, 1]
    areas = np.ptp(cos * x + sin * y, axis=1) * np.ptp(cos * y - sin * x, axis=1)
    return angles[areas <= areas.min() * (1 + 1e-9) + 1e-12]


def _rectangle(footprint, angle):
    """Area, angle and bounds of the footprint in axes turned by ``angle``."""
    turned = footprint @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    low, high = turned.min(axis=0), turned.max(axis=0)
    return float(np.prod(high - low)), float(angle), low, high
