"""Places that the robot can reach within a few strides, and how far each is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from agents.planning.planner_kernels import ways_over_grid
from sbm_gym.worlds.geometry.navigable import NavigableMap

CELLS_PER_STRIDE = 5
"""How finely ways are told apart."""


@dataclass(frozen=True)
class Reachable:
    """Places and the ways to them."""

    places_m: Float[np.ndarray, "n 2"]
    ways_m: Float[np.ndarray, "n"]
    """Length of the shortest way over a grid of eight neighbours, up to 8 % longer than the shortest of all."""


def reachable_places(
    navigable: NavigableMap, start_m: Float[np.ndarray, "2"], stride_m: float, reach_m: float
) -> Reachable:
    """A grid of places within reach, ``CELLS_PER_STRIDE`` to a stride; where the robot is comes first.

    Args:
        navigable: the map.
        start_m: where the robot is; just off the map the nearest free place counts.
        stride_m: its longest move.
        reach_m: longest way.
    """
    start_m = navigable.nearest_free(start_m)
    spacing_m = max(navigable.cell_m, stride_m / CELLS_PER_STRIDE)
    half = int(reach_m / spacing_m)
    # Twice as fine as the grid of places: between two of them there must be no obstacle either.
    steps = 0.5 * spacing_m * np.arange(-2 * half, 2 * half + 1)
    grid_m = start_m + np.stack(np.meshgrid(steps, steps), axis=-1)
    ways_m = ways_over_grid(navigable.are_free(grid_m), spacing_m, reach_m).ravel()
    found = np.flatnonzero(np.isfinite(ways_m))
    found = found[np.argsort(ways_m[found], kind="stable")]
    return Reachable(grid_m[::2, ::2].reshape(-1, 2)[found], ways_m[found])
