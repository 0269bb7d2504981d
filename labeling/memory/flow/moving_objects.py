"""What moves: voxels that hang together and flow alike are an object, with an upright box and a score. No label."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.boxes3d import fit_box
from labeling.core.geometry import transform_points
from labeling.core.types import Box3d
from labeling.memory.settings.grid_spec import GridSpec

LEAST_SHARE = 0.4
"""Probability from which on a voxel is said to move."""
LEAST_FLOW = 0.25
"""Of a voxel's edge: what flows by less stands still."""
ALIKE = 0.6
"""Of a voxel's edge: neighbours whose flows differ by less belong together."""
FEWEST_VOXELS, FEWEST_POINTS = 3, 15
"""Of an object."""
SURE_VOXELS = 6.0
"""An object of so many voxels is half as sure as one of very many whose voxels say the same."""
ABOVE_FLOOR_M = 0.03
"""Lower points are of the floor, not of an object on it, if enough others are left."""
MOVING = "moving"
"""The category of what moves: what it is, nobody says."""


@dataclass(frozen=True)
class MovingObject:
    """Something that has moved between two times."""

    box: Box3d
    """At the earlier time, world; upright."""
    displacement_m: Float[np.ndarray, "3"]
    """To the later time, world."""
    confidence: float
    """In [0, 1]."""


def moving_voxels(
    flow_m: Float[np.ndarray, "3 z y x"],
    moves: Float[np.ndarray, "z y x"],
    occupied: Float[np.ndarray, "z y x"],
    grid: GridSpec,
) -> Bool[np.ndarray, "z y x"]:
    """Which voxels are said to move, and by enough.

    Args:
        flow_m: x, y, z, metres.
        moves: probabilities.
        occupied: 1 where there is a surface.
        grid: of the voxels.
    """
    chosen = (occupied > 0) & (moves >= LEAST_SHARE)
    return chosen & (np.linalg.norm(flow_m, axis=0) >= LEAST_FLOW * grid.voxel_m)


def group_flow(
    flow_m: Float[np.ndarray, "3 z y x"],
    moves: Float[np.ndarray, "z y x"],
    occupied: Float[np.ndarray, "z y x"],
    grid: GridSpec,
) -> list[np.ndarray]:
    """Groups of voxels that hang together and flow alike.

    Args:
        flow_m: x, y, z, metres.
        moves: probabilities.
        occupied: 1 where there is a surface.
        grid: of the voxels.

    Returns:
        Of each group the flat indices of its voxels, rising; the largest first.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    chosen = moving_voxels(flow_m, moves, occupied, grid)
    voxels = np.argwhere(chosen)
    if len(voxels) == 0:
        return []
    number = np.full(np.array(chosen.shape) + 2, -1)
    number[tuple((voxels + 1).T)] = np.arange(len(voxels))
    flows = flow_m[:, *voxels.T].T
    edges = []
    for step in np.argwhere(np.ones((3, 3, 3)))[14:] - 1:  # half of the 26 neighbours
        other = number[tuple((voxels + 1 + step).T)]
        one = np.flatnonzero(other >= 0)
        alike = np.linalg.norm(flows[one] - flows[other[one]], axis=1) < ALIKE * grid.voxel_m
        edges.append(np.stack([one[alike], other[one][alike]]))
    ends = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(len(voxels), len(voxels)))
    count, component = connected_components(graph, directed=False)
    flat = np.ravel_multi_index(tuple(voxels.T), chosen.shape)
    groups = [flat[component == k] for k in range(count)]
    return sorted((one for one in groups if len(one) >= FEWEST_VOXELS), key=lambda one: -len(one))


def boxes_of_groups(
    groups: list[np.ndarray],
    flow_m: Float[np.ndarray, "3 z y x"],
    moves: Float[np.ndarray, "z y x"],
    points: Float[np.ndarray, "n 3"],
    grid: GridSpec,
    grid_to_world: Float[np.ndarray, "4 4"],
    floor_m: float | None,
) -> list[MovingObject]:
    """Objects of groups of voxels, the surest first.

    Args:
        groups: as ``group_flow`` gives them.
        flow_m: x, y, z, metres.
        moves: probabilities.
        points: that depth measured at the earlier time, in the frame of the grid, metres.
        grid: of the voxels.
        grid_to_world: where it stands; upright.
        floor_m: height of the floor in the frame of the grid, metres; None if it is not known.
    """
    import torch

    from labeling.memory.lifting.voxel_grid import voxel_of

    index, inside = voxel_of(grid, torch.from_numpy(points.astype(np.float32)))
    voxel = np.where(inside.numpy(), index.numpy(), -1)
    found = []
    for group in groups:
        own = _above_floor(points[np.isin(voxel, group)], floor_m)
        box = fit_box(transform_points(grid_to_world, own)) if len(own) >= FEWEST_POINTS else None
        if box is None:
            continue
        step = flow_m.reshape(3, -1)[:, group].mean(axis=1)
        sure = float(moves.reshape(-1)[group].mean()) * len(group) / (len(group) + SURE_VOXELS)
        found.append(MovingObject(box, grid_to_world[:3, :3] @ step, sure))
    return sorted(found, key=lambda one: -one.confidence)


def _above_floor(points: Float[np.ndarray, "n 3"], floor_m: float | None) -> Float[np.ndarray, "_ 3"]:
    """Without those of the floor, if it is known and enough are left."""
    if floor_m is None:
        return points
    high = points[points[:, 2] > floor_m + ABOVE_FLOOR_M]
    return high if len(high) >= FEWEST_POINTS else points
