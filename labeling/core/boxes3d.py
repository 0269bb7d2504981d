"""Gravity-aligned oriented boxes around segments of a cloud."""

import numpy as np
from jaxtyping import Float

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
    points = np.asarray(points, float)
    kept = _without_outliers(points, trim)
    corners = _hull(kept[:, :2])
    best = min((_rectangle(corners, angle) for angle in _edge_angles(corners)), key=lambda r: r[0])
    _, angle, low, high = best
    bottom, top = np.quantile(points[:, 2], [trim, 1 - trim])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    sides, middle = high - low, turn @ (0.5 * (low + high))
    if sides[1] > sides[0]:
        turn, sides = np.stack([turn[:, 1], -turn[:, 0]], axis=1), sides[::-1]
    rotation = np.eye(3)
    rotation[:2, :2] = turn
    extent = np.array([sides[0], sides[1], top - bottom]) + margin_m
    return Box3d(np.array([*middle, 0.5 * (bottom + top)]), extent, rotation)


def _without_outliers(points, trim):
    """Points inside the per-axis quantiles, so that single outliers do not stretch the footprint's hull."""
    low, high = np.quantile(points, [trim, 1 - trim], axis=0)
    kept = points[np.all((points >= low - 1e-9) & (points <= high + 1e-9), axis=1)]
    return kept if len(kept) else points


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


def _rectangle(footprint, angle):
    """Area, angle and bounds of the footprint in axes turned by ``angle``."""
    turned = footprint @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    low, high = turned.min(axis=0), turned.max(axis=0)
    return float(np.prod(high - low)), float(angle), low, high
