"""Which way is up, told by the floor: the direction in which most level surfaces face that the cameras look down on."""

import numpy as np
from jaxtyping import Float, Float32

from labeling.core.views import RgbdViews

MAX_VIEWS = 16
"""Views that are looked at, spread evenly."""
ACROSS = 48
"""Patches across a view: their means have little noise left, and four neighbours span a surface."""
BEND = 0.02
"""How far the fourth of them may lie off the plane of three, as a share of its distance."""
NEAR_DEG, APART_DEG = 7.0, 20.0
"""Normals so near are of one direction; directions so far apart are rivals."""
LEAN_DEG = 60.0
"""How far the floor's normal may be from the mean upper edge of the pictures: walls and ceilings are farther."""
LEAST_MEAN = 0.2
"""Length that this mean must have: rolled cameras, or such that look straight down, do not tell up from down."""
LEAST_SHARE, LEAD = 0.05, 1.25
"""Share of all surfaces that the floor needs, and the factor by which it must exceed the next direction."""
FLAT = 0.01
"""Points of one plane lie this near to it, as a share of the median distance of what is seen."""
CANDIDATES = 400


def floor_normal(views: RgbdViews) -> Float[np.ndarray, "3"] | None:
    """The normal of the largest plane that faces up, as far as the cameras' upper edges tell what that is.

    The floor is best; a large table does as well, since it is as level.

    Args:
        views: of one recording; all are looked at.

    Returns:
        Unit vector in the recording's world; None if no plane that most cameras stand above clearly wins.
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
    """Points of flat places in a view, and their normals towards the camera; world."""
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
    """The middle of the interval of this width that holds most of some values."""
    values = np.sort(values)
    last = np.searchsorted(values, values + width, side="right")
    first = int((last - np.arange(len(values))).argmax())
    return float(np.median(values[first : last[first]]))
