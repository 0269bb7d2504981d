"""Where the agent can stand and how it gets from place to place, on a grid of the floor."""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sbm_gym.worlds.geometry import grid_kernels

AGENT_RADIUS_M = 0.18
"""Radius of the agent's body, a pole."""
BEARINGS = 18
"""Directions from an object that are told apart. Source: the published code (yaw bins of 20 degrees)."""


@dataclass(frozen=True)
class NavigableMap:
    """Grid of places for the agent's centre. Every point of a free cell is free, and nothing outside the grid is."""

    free: Bool[np.ndarray, "ny nx"]
    """Row ``i``, column ``j`` covers ``origin_m + cell_m * ([j, i] .. [j + 1, i + 1])``."""
    origin_m: Float[np.ndarray, "2"]
    """World (x, y) of the outer corner of cell (0, 0)."""
    cell_m: float = 0.05

    def is_free(self, xy_m: Float[np.ndarray, "2"]) -> bool:
        """Whether the agent collides with nothing when its centre is at ``xy_m``."""
        j, i = np.floor((np.asarray(xy_m, float) - self.origin_m) / self.cell_m).astype(int)
        return bool(0 <= i < self.free.shape[0] and 0 <= j < self.free.shape[1] and self.free[i, j])

    def are_free(self, xy_m: Float[np.ndarray, "*n 2"]) -> Bool[np.ndarray, "*n"]:
        """``is_free`` of many places at once."""
        cells = np.floor((xy_m - self.origin_m) / self.cell_m).astype(np.int64)
        rows, columns = self.free.shape
        inside = (cells[..., 0] >= 0) & (cells[..., 0] < columns) & (cells[..., 1] >= 0) & (cells[..., 1] < rows)
        free = np.zeros(inside.shape, bool)
        free[inside] = self.free[cells[..., 1][inside], cells[..., 0][inside]]
        return free

    def free_around(
        self, centre_m: Float[np.ndarray, "2"], distances_m: Sequence[float] | Float[np.ndarray, "distances"]
    ) -> Bool[np.ndarray, "bearings distances"]:
        """Which of the places around a point are free, in ``BEARINGS`` directions."""
        bearings = np.arange(BEARINGS) * (2 * np.pi / BEARINGS)
        directions = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
        return self.are_free(centre_m + directions[:, None] * np.array(distances_m)[:, None])

    def random_point(self, rng: np.random.Generator) -> Float[np.ndarray, "2"]:
        """A point drawn evenly from the largest connected part of the free space.

        Raises:
            ValueError: if nothing is free.
        """
        cells = self._connected_cells()
        i, j = cells[rng.integers(len(cells))]
        # Kept off the cell's very edges, so that rounding never puts the point into a neighbour.
        return self.origin_m + self.cell_m * (np.array([j, i]) + rng.uniform(1e-6, 1 - 1e-6, 2))

    def nearest_free(self, xy_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """The free point nearest to ``xy_m``: itself if free, else the centre of the nearest free cell.

        Cells of the largest connected part only, so that one can always get away from there.

        Raises:
            ValueError: if nothing is free.
        """
        xy_m = np.asarray(xy_m, float)
        if self.is_free(xy_m):
            return xy_m.copy()
        centres = self._centres_m(self._connected_cells())
        return centres[int(np.argmin(np.sum((centres - xy_m) ** 2, axis=1)))]

    def _connected_cells(self) -> Int[np.ndarray, "n 2"]:
        cells = np.argwhere(self.largest_component)
        if len(cells) == 0:
            raise ValueError("the map has no free cell")
        return cells

    def line_is_free(self, a_m: Float[np.ndarray, "2"], b_m: Float[np.ndarray, "2"]) -> bool:
        """Whether the agent can go straight from ``a_m`` to ``b_m``: every cell on the way is free."""
        return self.first_straight(a_m, np.asarray(b_m, float)[None]) == 0

    def first_straight(self, start_m: Float[np.ndarray, "2"], ends_m: Float[np.ndarray, "n 2"]) -> int:
        """The first of some places that the agent can go straight to, -1 if there is none."""
        x, y = float(start_m[0]), float(start_m[1])
        return grid_kernels.first_straight(self.free, self.origin_m, self.cell_m, x, y, ends_m)

    def shortest_path(
        self, start_m: Float[np.ndarray, "2"], goal_m: Float[np.ndarray, "2"]
    ) -> Float[np.ndarray, "k 2"] | None:
        """A short way between two points, around obstacles.

        Shortest over the grid (8 neighbours, never diagonally past a blocked cell), then pulled straight where the
        line of sight allows.

        Returns:
            Corner points from ``start_m`` to ``goal_m``, both included; None if either is not free or there is no way.
        """
        from scipy.sparse.csgraph import dijkstra

        start_m, goal_m = np.asarray(start_m, float), np.asarray(goal_m, float)
        if not (self.is_free(start_m) and self.is_free(goal_m)):
            return None
        if self.line_is_free(start_m, goal_m):
            return np.stack([start_m, goal_m])
        start, goal = self._node(start_m), self._node(goal_m)
        # Most ways are not much longer than the crow flies; to search no farther saves most of the time.
        for limit_m in (2.0 * float(np.linalg.norm(goal_m - start_m)) + 1.0, np.inf):
            _, before = dijkstra(self._graph, indices=start, return_predecessors=True, limit=limit_m)
            if before[goal] >= 0 or goal == start:
                break
        else:
            return None
        nodes = [goal]
        while nodes[-1] != start:
            nodes.append(int(before[nodes[-1]]))
        way = np.concatenate([start_m[None], self._centres_m(self._free_cells[nodes[::-1]]), goal_m[None]])
        kept = [way[0]]
        for here, ahead in itertools.pairwise(way[1:]):
            if not self.line_is_free(kept[-1], ahead):
                kept.append(here)
        return np.stack([*kept, way[-1]])

    @functools.cached_property
    def largest_component(self) -> Bool[np.ndarray, "ny nx"]:
        """The cells of the largest connected part of the free space (cells touch along edges)."""
        import cv2

        count, labels = cv2.connectedComponents(np.ascontiguousarray(self.free).view(np.uint8), connectivity=4)
        if count == 1:
            return np.zeros_like(self.free)
        cells = np.bincount(labels.ravel())[1:]
        largest = np.flatnonzero(cells == cells.max()) + 1
        # Of several as large as each other the first one, row by row.
        flat = labels.ravel()
        return labels == min(largest, key=lambda part: int(np.argmax(flat == part)) if len(largest) > 1 else 0)

    def connected(self) -> "NavigableMap":
        """The map without places that cannot be reached from its largest connected part."""
        return NavigableMap(self.largest_component, self.origin_m, self.cell_m)

    def without(self, obstacles: Float[np.ndarray, "n 5"], clearance_m: float = 0.0) -> "NavigableMap":
        """The map with more boxes on it, without places that come nearer to them than ``clearance_m``.

        Args:
            obstacles: as of ``navigable_map``.
            clearance_m: between the agent's body and a box, at least.
        """
        free, (rows, columns) = self.free.copy(), self.free.shape
        x = self.origin_m[0] + self.cell_m * (np.arange(columns) + 0.5)
        y = self.origin_m[1] + self.cell_m * (np.arange(rows) + 0.5)
        _block(free, x, y, obstacles, AGENT_RADIUS_M + self.cell_m * np.sqrt(0.5) + clearance_m)
        return NavigableMap(free, self.origin_m, self.cell_m)

    @functools.cached_property
    def _free_cells(self) -> Int[np.ndarray, "n 2"]:
        return np.argwhere(self.free)

    @functools.cached_property
    def _node_of_cell(self) -> Int[np.ndarray, "ny nx"]:
        nodes = np.full(self.free.shape, -1)
        nodes[self.free] = np.arange(np.count_nonzero(self.free))
        return nodes

    @functools.cached_property
    def _graph(self):
        """Neighbouring free cells with their distances, as a sparse matrix over the free cells."""
        from scipy.sparse import coo_array

        nodes, ny, nx = self._node_of_cell, *self.free.shape
        sources, targets, lengths = [], [], []
        for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
            rows, columns = slice(0, ny - di), slice(max(0, -dj), nx - max(0, dj))
            rows_on, columns_on = slice(di, ny), slice(max(0, dj), nx + min(0, dj))
            here, there = nodes[rows, columns], nodes[rows_on, columns_on]
            linked = (here >= 0) & (there >= 0)
            if di and dj:
                linked &= self.free[rows, columns_on] & self.free[rows_on, columns]
            sources.append(here[linked])
            targets.append(there[linked])
            lengths.append(np.full(np.count_nonzero(linked), self.cell_m * np.hypot(di, dj)))
        source, target, length = map(np.concatenate, (sources, targets, lengths))
        size = len(self._free_cells)
        both = (np.concatenate([source, target]), np.concatenate([target, source]))
        return coo_array((np.concatenate([length, length]), both), shape=(size, size)).tocsr()

    def _node(self, xy_m: Float[np.ndarray, "2"]) -> int:
        j, i = np.floor((xy_m - self.origin_m) / self.cell_m).astype(int)
        return int(self._node_of_cell[i, j])

    def _centres_m(self, cells: Int[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        return self.origin_m + self.cell_m * (cells[:, ::-1] + 0.5)


def navigable_map(
    low_m: Float[np.ndarray, "2"],
    high_m: Float[np.ndarray, "2"],
    obstacles: Float[np.ndarray, "n 5"],
    cell_m: float = 0.05,
) -> NavigableMap:
    """The map of a rectangular floor with boxes on it.

    A cell is free if the agent touches nothing wherever in the cell its centre is.

    Args:
        low_m: least (x, y) of the floor; beyond it are walls.
        high_m: greatest (x, y) of the floor.
        obstacles: for each box its centre x and y, its half sizes along its own axes, and its yaw (rad).
        cell_m: edge length of a cell.
    """
    low_m, high_m = np.asarray(low_m, float), np.asarray(high_m, float)
    nx, ny = np.maximum(np.ceil((high_m - low_m) / cell_m - 1e-9).astype(int), 1)
    x, y = low_m[0] + cell_m * (np.arange(nx) + 0.5), low_m[1] + cell_m * (np.arange(ny) + 0.5)
    reach = AGENT_RADIUS_M + cell_m * np.sqrt(0.5)  # the farthest point of a cell from its centre
    wall = AGENT_RADIUS_M + 0.5 * cell_m
    free_x = (x - low_m[0] >= wall) & (high_m[0] - x >= wall)
    free_y = (y - low_m[1] >= wall) & (high_m[1] - y >= wall)
    free = free_y[:, None] & free_x[None]
    _block(free, x, y, obstacles, reach)
    return NavigableMap(free, low_m, cell_m)


def _block(
    free: Bool[np.ndarray, "ny nx"],
    x: Float[np.ndarray, "nx"],
    y: Float[np.ndarray, "ny"],
    obstacles: Float[np.ndarray, "n 5"],
    reach: float,
) -> None:
    """Marks the cells whose centres come nearer than ``reach`` to a box as not free, in place."""
    for centre_x, centre_y, half_x, half_y, yaw in np.asarray(obstacles, float).reshape(-1, 5):
        cos, sin = np.cos(yaw), np.sin(yaw)
        # Only the cells around the box can change.
        wide = abs(half_x * cos) + abs(half_y * sin) + reach
        tall = abs(half_x * sin) + abs(half_y * cos) + reach
        columns = slice(*np.searchsorted(x, [centre_x - wide, centre_x + wide]))
        rows = slice(*np.searchsorted(y, [centre_y - tall, centre_y + tall]))
        off_x, off_y = x[columns][None] - centre_x, y[rows][:, None] - centre_y
        along = np.abs(off_x * cos + off_y * sin) - half_x
        across = np.abs(off_y * cos - off_x * sin) - half_y
        free[rows, columns] &= np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) >= reach
