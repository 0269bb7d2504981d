"""Places that the robot can reach within a few strides, and how far each is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.navigable import NavigableMap

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
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    start_m = navigable.nearest_free(start_m)
    spacing_m = max(navigable.cell_m, stride_m / CELLS_PER_STRIDE)
    half = int(reach_m / spacing_m)
    steps = np.arange(-half, half + 1) * spacing_m
    grid_m = start_m + np.stack(np.meshgrid(steps, steps), axis=-1)
    free = navigable.are_free(grid_m)
    nodes = np.full(free.shape, -1)
    nodes[free] = np.arange(np.count_nonzero(free))
    sources, targets, lengths = [], [], []
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, len(free) - rows), slice(max(0, -columns), len(free) - max(0, columns)))
        there = (slice(rows, len(free)), slice(max(0, columns), len(free) + min(0, columns)))
        linked = free[here] & free[there] & navigable.are_free(0.5 * (grid_m[here] + grid_m[there]))
        sources.append(nodes[here][linked])
        targets.append(nodes[there][linked])
        lengths.append(np.full(np.count_nonzero(linked), spacing_m * np.hypot(rows, columns)))
    source, target, length = map(np.concatenate, (sources, targets, lengths))
    count = np.count_nonzero(free)
    graph = coo_array((length, (source, target)), shape=(count, count)).tocsr()
    ways_m = dijkstra(graph, directed=False, indices=nodes[half, half], limit=reach_m)
    found = np.flatnonzero(np.isfinite(ways_m))
    found = found[np.argsort(ways_m[found], kind="stable")]
    return Reachable(grid_m[free][found], ways_m[found])
