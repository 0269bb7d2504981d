"""Where the grid of a memory stands in a recording: upright, around what the cameras look at or what they have seen."""

import numpy as np
from jaxtyping import Float

from labeling.core.geometry import unproject_depth
from labeling.core.views import RgbdViews
from labeling.memory.settings.grid_spec import Around, GridSpec

FLOOR_QUANTILE, FLOOR_VOXELS = 0.02, 1.0
"""Which of all heights is taken for the floor's, and how many voxels of the grid lie below it (``floor_height``)."""
POINTS_PER_VIEW = 500
ROUNDS, TRUSTED_M = 20, 0.3
"""Of reweighting, and how near to the point an optical axis passes that counts in full."""


def fixated_point(views: RgbdViews) -> Float[np.ndarray, "3"] | None:
    """The point that most optical axes pass by: what the cameras look at, world, metres.

    Returns:
        None where they look nowhere in common: fewer than two views, or parallel gazes.

    Source: least squares of distances to lines, reweighted (Cauchy).
    """
    origins, gazes = views.camera_to_world[:, :3, 3], views.camera_to_world[:, :3, 2]
    across = np.eye(3) - gazes[:, :, None] * gazes[:, None, :]
    weights = np.ones(len(gazes))
    point = np.zeros(3)
    for _ in range(ROUNDS):
        matrix = np.einsum("v,vij->ij", weights, across)
        if np.linalg.eigvalsh(matrix)[0] < 1e-3 * len(gazes):
            return None
        point = np.linalg.solve(matrix, np.einsum("v,vij,vj->i", weights, across, origins))
        away_m = np.linalg.norm(np.einsum("vij,vj->vi", across, point - origins), axis=1)
        weights = 1 / (1 + (away_m / TRUSTED_M) ** 2)
    return point


def seen_points(views: RgbdViews) -> Float[np.ndarray, "n 3"]:
    """Some of the points that depth measured in all views, world, metres; the same ones each time."""
    found = []
    for view in range(views.num_views):
        camera = views.camera(view)
        points, _ = unproject_depth(views.depth_m[view], camera.intrinsics, camera.camera_to_world)
        found.append(points[:: max(1, len(points) // POINTS_PER_VIEW)])
    return np.concatenate(found)


def grid_centre(views: RgbdViews, spec: GridSpec, around: Around = "fixated") -> Float[np.ndarray, "3"]:
    """Where the middle of the grid stands, world, metres; see ``grid_and_floor``."""
    return grid_and_floor(views, spec, around)[0]


def grid_and_floor(
    views: RgbdViews, spec: GridSpec, around: Around = "fixated"
) -> tuple[Float[np.ndarray, "3"], float | None]:
    """Where the middle of the grid stands, and the height of the floor in it; world, metres.

    Args:
        views: of the recording.
        spec: of the grid.
        around: the point that the cameras look at, if there is one; or the median of what they have seen. In height the
            grid begins a voxel below the floor, if it then reaches the point.

    Returns:
        The middle, and the floor; None if the grid had to be placed without one (``floor_height``).

    Raises:
        ValueError: if there is no depth at all.
    """
    points = seen_points(views)
    if not len(points):
        raise ValueError("no view has any depth")
    centre = fixated_point(views) if around == "fixated" else None
    if centre is None:
        centre = np.median(points, axis=0)
    floor_m = floor_height(points, centre, spec)
    if floor_m is not None:
        bottom = floor_m - FLOOR_VOXELS * spec.voxel_m
        centre = np.array([centre[0], centre[1], bottom + 0.5 * spec.extent_m[2]])
    return centre, floor_m


def floor_height(points: Float[np.ndarray, "n 3"], centre_m: Float[np.ndarray, "3"], spec: GridSpec) -> float | None:
    """Height of the floor around a point, world, metres.

    Args:
        points: that were measured, world.
        centre_m: what the grid is to be placed around, world.
        spec: of the grid.

    Returns:
        The height below which ``FLOOR_QUANTILE`` of the points above and below the grid lie. None if there are none,
        or if a grid that begins ``FLOOR_VOXELS`` below it does not reach the point: then it is not this floor that
        things in the grid stand on.
    """
    near = points[np.linalg.norm(points[:, :2] - centre_m[:2], axis=1) < 0.5 * spec.extent_m[0]]
    if not len(near):
        return None
    floor_m = float(np.quantile(near[:, 2], FLOOR_QUANTILE))
    bottom = floor_m - FLOOR_VOXELS * spec.voxel_m
    return floor_m if bottom <= centre_m[2] <= bottom + spec.extent_m[2] else None


def place_grid(centre_m: Float[np.ndarray, "3"], camera_to_world: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """``grid_to_world`` of an upright grid whose +X is the heading of a camera.

    Args:
        centre_m: middle of the grid, world.
        camera_to_world: of the first view that goes into the memory. Of one that looks straight up or down, the top of
            its picture is the heading.
    """
    heading = camera_to_world[:2, 2]
    if np.linalg.norm(heading) < 1e-6:
        heading = -camera_to_world[:2, 1]
    x, y = heading / np.linalg.norm(heading)
    grid_to_world = np.eye(4)
    grid_to_world[:2, :2] = [[x, -y], [y, x]]
    grid_to_world[:3, 3] = centre_m
    return grid_to_world
