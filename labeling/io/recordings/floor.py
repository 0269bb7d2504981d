"""Finding the up direction of a recording from the floor: the largest plane that faces the cameras' upper edges."""

import numpy as np
from jaxtyping import Float, Float32

from labeling.core.views import RgbdViews

MAX_VIEWS = 16
"""Most views that are read, spread evenly over the recording."""
ACROSS = 48
"""Patches across a view; depth is averaged over each, and four neighbours are tested for lying on a plane."""
BEND = 0.02
"""Largest distance of the fourth patch from the plane of the three others, as a share of its depth."""
NEAR_DEG, APART_DEG = 7.0, 20.0
"""Largest angle between normals of one direction, and least angle between two competing directions."""
LEAN_DEG = 60.0
"""Largest angle of the floor's normal from the mean upward direction of the cameras; walls and ceilings exceed it."""
LEAST_MEAN = 0.2
"""Least length of that mean: with rolled cameras, or cameras that look straight down, up cannot be told from down."""
LEAST_SHARE, LEAD = 0.05, 1.25
"""Least share of all surfaces with the floor's direction, and least ratio to the next direction's."""
FLAT = 0.01
"""Largest distance of points from their plane, as a share of the median distance of all points."""
CANDIDATES = 400


def floor_normal(views: RgbdViews) -> Float[np.ndarray, "3"] | None:
    """The normal of the largest plane that faces up, which is the floor or something as level, such as a large table.

    Args:
        views: of one recording; all are used.

    Returns:
        Unit vector in the recording's world frame; None if no plane below most cameras is clearly the largest.
    """
    up = -np.mean(views.camera_to_world[:, :3, 1], axis=0)
    if np.linalg.norm(up) < LEAST_MEAN:
        return None
    up /= np.linalg.norm(up)
    found = [_surfaces(views.depth_m[v], views.intrinsics[v], views.camera_to_world[v]) for v in range(views.num_views)]
    points, normals = (np.concatenate(part) for part in zip(*found, strict=True))
    upright = normals[normals @ up > np.cos(np.deg2rad(LEAN_DEG))]
    if len(upright) == 0:
        return None
    tried = upright[:: -(-len(upright) // CANDIDATES)]
    support = np.count_nonzero(tried @ normals.T > np.cos(np.deg2rad(NEAR_DEG)), axis=1)
    best = int(support.argmax())
    rivals = support[tried @ tried[best] < np.cos(np.deg2rad(APART_DEG))]
    if support[best] < max(LEAST_SHARE * len(normals), LEAD * rivals.max(initial=0)):
        return None
    normal, eyes = tried[best], np.asarray(views.camera_to_world[:, :3, 3], float)
    distance_m = float(np.median(np.linalg.norm(points - eyes.mean(axis=0), axis=1)))
    for _ in range(4):
        facing = points[normals @ normal > np.cos(np.deg2rad(NEAR_DEG))]
        height = _commonest(facing @ normal, FLAT * distance_m)
        plane = facing[np.abs(facing @ normal - height) < 2 * FLAT * distance_m]
        if len(plane) < 3:
            return None
        middle = plane.mean(axis=0)
        fitted = np.linalg.svd(plane - middle, full_matrices=False)[2][2]
        normal = fitted if fitted @ normal > 0 else -fitted
    return normal if np.mean((eyes - middle) @ normal > 0) > 0.5 else None


def _surfaces(
    depth_m: Float32[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], camera_to_world: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points on flat patches of a view, metres, and their unit normals towards the camera; world frame."""
    side = max(1, round(depth_m.shape[1] / ACROSS))
    rows, columns = (length // side for length in depth_m.shape)
    y, x = np.mgrid[0 : rows * side, 0 : columns * side]
    z = np.asarray(depth_m[: rows * side, : columns * side], float)
    rays = np.stack([x, y, np.ones(x.shape)], axis=-1) @ np.linalg.inv(intrinsics).T
    patches = (rows, side, columns, side)
    count = np.count_nonzero((z > 0).reshape(patches), axis=(1, 3))
    summed = (rays * z[..., None]).reshape(*patches, 3).sum(axis=(1, 3))
    middle = summed / np.maximum(count, 1)[..., None]
    known = count > 0.5 * side**2
    corner, right, below, across = middle[:-1, :-1], middle[:-1, 1:], middle[1:, :-1], middle[1:, 1:]
    normal = np.cross(below - corner, right - corner)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    flat = np.abs(((across - corner) * normal).sum(axis=-1)) < BEND * corner[..., 2]
    flat &= known[:-1, :-1] & known[:-1, 1:] & known[1:, :-1] & known[1:, 1:]
    corner, normal = corner[flat], normal[flat]
    normal *= -np.sign((normal * corner).sum(axis=1, keepdims=True))
    turn = camera_to_world[:3, :3]
    return corner @ turn.T + camera_to_world[:3, 3], normal @ turn.T


def _commonest(values: Float[np.ndarray, "n"], width: float) -> float:
    """The middle of the interval of a given width that holds the most values."""
    values = np.sort(values)
    last = np.searchsorted(values, values + width, side="right")
    first = int((last - np.arange(len(values))).argmax())
    return float(np.median(values[first : last[first]]))
