"""Cutting polygons into triangles: fans for convex ones, ear clipping for the rest."""

import numpy as np
from jaxtyping import Bool, Float, Int


def triangulate(points: Float[np.ndarray, "v 3"], polygons: Int[np.ndarray, "p n"]) -> Int[np.ndarray, "t 3"]:
    """Triangulates polygons that all have ``n`` corners.

    Args:
        points: positions, any unit.
        polygons: for each polygon the indices of its corners, in order.

    Returns:
        For each triangle three numbers below ``p * n``: positions in ``polygons.ravel()``, so that attributes given
        per corner follow along. Every polygon gives ``n - 2`` triangles, in the order of the polygons.
    """
    count, corners = polygons.shape
    fan = np.stack([np.zeros(corners - 2, int), np.arange(1, corners - 1), np.arange(2, corners)], axis=1)
    local = np.broadcast_to(fan, (count, corners - 2, 3)).copy()
    if corners > 3:
        positions = points[polygons]
        for index in np.flatnonzero(~_convex(positions)):
            local[index] = _clip_ears(positions[index])
    return (local + (np.arange(count) * corners)[:, None, None]).reshape(-1, 3)


def _convex(positions: Float[np.ndarray, "p n 3"]) -> Bool[np.ndarray, "p"]:
    """Whether every corner of a polygon turns the same way as the polygon itself (its Newell normal)."""
    edge = np.roll(positions, -1, axis=1) - positions
    normal = np.cross(positions, np.roll(positions, -1, axis=1)).sum(axis=1)
    turn = np.einsum("pnk,pk->pn", np.cross(np.roll(edge, 1, axis=1), edge), normal)
    scale = np.einsum("pk,pk->p", normal, normal)
    return np.all(turn >= -1e-9 * scale[:, None], axis=1)


def _clip_ears(positions: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n-2 3"]:
    """Triangles of one simple polygon by ear clipping, in the plane across its Newell normal."""
    normal = np.cross(positions, np.roll(positions, -1, axis=0)).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    keep = [(axis + 1) % 3, (axis + 2) % 3]
    flat = positions[:, keep] * np.array([np.sign(normal[axis]) or 1.0, 1.0])
    left, triangles = list(range(len(positions))), []
    while len(left) > 3:
        for at in range(len(left)):
            a, b, c = left[at - 1], left[at], left[(at + 1) % len(left)]
            if _is_ear(flat, a, b, c, left):
                break
        else:
            at = 0  # the polygon crosses itself: any cut is as good as another
            a, b, c = left[at - 1], left[at], left[1]
        triangles.append((a, b, c))
        del left[at]
    triangles.append(tuple(left))
    return np.array(triangles)


def _is_ear(flat: Float[np.ndarray, "n 2"], a: int, b: int, c: int, left: list[int]) -> bool:
    if _cross(flat[b] - flat[a], flat[c] - flat[b]) <= 0:
        return False
    for other in left:
        if other in (a, b, c) or any(np.array_equal(flat[other], flat[corner]) for corner in (a, b, c)):
            continue
        sides = (
            _cross(flat[b] - flat[a], flat[other] - flat[a]),
            _cross(flat[c] - flat[b], flat[other] - flat[b]),
            _cross(flat[a] - flat[c], flat[other] - flat[c]),
        )
        if min(sides) >= 0:
            return False
    return True


def _cross(u: Float[np.ndarray, "2"], v: Float[np.ndarray, "2"]) -> float:
    return float(u[0] * v[1] - u[1] * v[0])
