"""Following a shortest path over the navigable map, one stride at a time."""

import itertools

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.geometry.navigable import NavigableMap


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


def _point_along(path: Float[np.ndarray, "k 2"], distance_m: float) -> Float[np.ndarray, "2"]:
    """The point that far along a polyline, or its end."""
    for start, end in itertools.pairwise(path):
        length_m = float(np.linalg.norm(end - start))
        if length_m >= distance_m:
            return start + (end - start) * (distance_m / max(length_m, 1e-12))
        distance_m -= length_m
    return path[-1]
