"""Shortest paths over the navigable map: the next stride on one, their lengths, and what is within reach."""

import itertools

import numpy as np
from jaxtyping import Float

from agents.planning.kernels import grid_path_lengths
from sbm_gym.worlds.geometry.navigable import NavigableMap

CELLS_PER_STRIDE = 5
"""Resolution of the grid of ``reachable_places``."""


def advance(
    navigable: NavigableMap, position_m: Float[np.ndarray, "2"], goal_m: Float[np.ndarray, "2"], stride_m: float
) -> Float[np.ndarray, "2"] | None:
    """The next straight move on the shortest path to a goal.

    Args:
        navigable: the map.
        position_m: where the body is; just off the map (it leans against something) the nearest free place counts.
        goal_m: where it wants to go.
        stride_m: longest move.

    Returns:
        A displacement of at most a stride; None if there is no path.
    """
    start_m = position_m if navigable.is_free(position_m) else navigable.nearest_free(position_m)
    path = navigable.shortest_path(start_m, goal_m)
    if path is None:
        return None
    ahead_m = _point_along(path, stride_m)
    if not navigable.line_is_free(start_m, ahead_m):
        ahead_m = path[1]
    step_m = ahead_m - position_m
    length_m = float(np.linalg.norm(step_m))
    return step_m if length_m <= stride_m else step_m * (stride_m / length_m)


def path_length_m(navigable: NavigableMap, position_m: Float[np.ndarray, "2"], goal_m: Float[np.ndarray, "2"]) -> float:
    """Length of the shortest path to a goal, infinite if there is none."""
    path = navigable.shortest_path(navigable.nearest_free(position_m), goal_m)
    return float("inf") if path is None else float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def reachable_places(
    navigable: NavigableMap, start_m: Float[np.ndarray, "2"], stride_m: float, max_length_m: float
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """A grid of places within reach, ``CELLS_PER_STRIDE`` to a stride; where the robot is comes first.

    Args:
        navigable: the map.
        start_m: where the robot is; just off the map the nearest free place counts.
        stride_m: its longest move.
        max_length_m: longest path.

    Returns:
        The places, and the lengths of the shortest paths to them over a grid of eight neighbours, which are up to 8 %
        longer than the shortest of all.
    """
    start_m = navigable.nearest_free(start_m)
    spacing_m = max(navigable.cell_m, stride_m / CELLS_PER_STRIDE)
    half = int(max_length_m / spacing_m)
    # Twice as fine as the grid of places: between two of them there must be no obstacle either.
    offsets_m = 0.5 * spacing_m * np.arange(-2 * half, 2 * half + 1)
    grid_m = start_m + np.stack(np.meshgrid(offsets_m, offsets_m), axis=-1)
    lengths_m = grid_path_lengths(navigable.are_free(grid_m), spacing_m, max_length_m).ravel()
    found = np.flatnonzero(np.isfinite(lengths_m))
    found = found[np.argsort(lengths_m[found], kind="stable")]
    return grid_m[::2, ::2].reshape(-1, 2)[found], lengths_m[found]


def _point_along(path: Float[np.ndarray, "k 2"], distance_m: float) -> Float[np.ndarray, "2"]:
    """The point that far along a polyline, or its end."""
    for start, end in itertools.pairwise(path):
        length_m = float(np.linalg.norm(end - start))
        if length_m >= distance_m:
            return start + (end - start) * (distance_m / max(length_m, 1e-12))
        distance_m -= length_m
    return path[-1]
