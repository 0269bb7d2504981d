"""Places that the robot can reach within a few strides, and how far each is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from agents.planning.kernels import grid_path_lengths
from sbm_gym.worlds.geometry.navigable import NavigableMap

CELLS_PER_STRIDE = 5
"""Resolution of the grid that paths are searched on."""


@dataclass(frozen=True)
class ReachablePlaces:
    """Places and the lengths of the paths to them."""

    places_m: Float[np.ndarray, "n 2"]
    lengths_m: Float[np.ndarray, "n"]
    """Of the shortest path over a grid of eight neighbours, up to 8 % longer than the shortest of all."""


def reachable_places(
    navigable: NavigableMap, start_m: Float[np.ndarray, "2"], stride_m: float, max_length_m: float
) -> ReachablePlaces:
    """A grid of places within reach, ``CELLS_PER_STRIDE`` to a stride; where the robot is comes first.

    Args:
        navigable: the map.
        start_m: where the robot is; just off the map the nearest free place counts.
        stride_m: its longest move.
        max_length_m: longest path.
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
    return ReachablePlaces(grid_m[::2, ::2].reshape(-1, 2)[found], lengths_m[found])
