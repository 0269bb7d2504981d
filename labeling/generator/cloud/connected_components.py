"""Connected components of a segment that are no part of it: noise of depth and pose, the ground, other objects."""

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

MAX_CELLS = 4_000_000


def detached_points(
    points: Float32[np.ndarray, "n 3"],
    object_of_point: Int32[np.ndarray, "n"],
    num_objects: int,
    gap_m: float,
    min_share: float,
    reach: float = np.inf,
    support: Float32[np.ndarray, "n"] | None = None,
) -> Bool[np.ndarray, "n"]:
    """Points in connected components of their object that are too far from it, or too small, to be a part of it.

    Args:
        points: world points, metres.
        object_of_point: index of the object, -1 for none.
        num_objects: how many objects there are.
        gap_m: components nearer to each other than about this are one.
        min_share: components with less than this share of the object's points are detached. An object that another one
            hides in part falls into a few large components: these stay.
        reach: so are components of any size that are further from the body, and from all that is part of it, than this
            share of the body's diagonal.
        support: sum of the confidences of the detections of its object at each point. The component with the most is
            the body; by default the one with the most points.
    """
    detached = np.zeros(len(points), bool)
    for k in range(num_objects):
        members = np.flatnonzero(object_of_point == k)
        if len(members) == 0:
            continue
        own = points[members]
        piece = _components(own, gap_m)
        size = np.bincount(piece)
        known = size if support is None else np.bincount(piece, weights=support[members].astype(float))
        body = int(known.argmax() if known.any() else size.argmax())
        kept = np.ones(len(size), bool)
        if np.isfinite(reach):
            kept = _within_reach(own, piece, size >= min_share * size[body], body, reach)
        kept &= size >= min_share * size[kept].sum()
        kept[body] = True
        detached[members[~kept[piece]]] = True
    return detached


def _components(points, gap_m: float) -> Int32[np.ndarray, "n"]:
    """Numbers of the connected pieces that points lie in, from 0."""
    low, edge = points.min(axis=0), gap_m
    # A cloud with points far apart would need a huge grid: coarser cells only join more pieces.
    while np.prod(np.ceil((points.max(axis=0) - low) / edge) + 1) > MAX_CELLS:
        edge *= 2
    piece, _ = label_cells(np.floor((points - low) / edge).astype(int))
    return piece


def label_cells(cell: Int[np.ndarray, "n 3"]) -> tuple[Int32[np.ndarray, "n"], int]:
    """Connected components of occupied cells of a grid; cells that share a face, an edge or a corner are connected.

    Args:
        cell: indices of the cells, from 0.

    Returns:
        The component of each cell, numbered from 0, and the number of components.
    """
    from scipy import ndimage

    grid = np.zeros(cell.max(axis=0) + 1, bool)
    grid[tuple(cell.T)] = True
    component = np.zeros(grid.shape, np.int32)
    ndimage.label(grid, structure=np.ones((3, 3, 3)), output=component)
    return component[tuple(cell.T)] - 1, int(component.max())


def _within_reach(points, piece, candidates, body: int, reach: float) -> Bool[np.ndarray, "k"]:
    """Pieces that a chain of short gaps leads to from the body."""
    from scipy.spatial import cKDTree

    limit_m = reach * float(np.linalg.norm(np.ptp(points[piece == body], axis=0)))
    found, new = np.zeros(len(candidates), bool), [body]
    left = [int(k) for k in np.flatnonzero(candidates) if k != body]
    while new:
        found[new] = True
        tree = cKDTree(points[np.isin(piece, new)])
        new = [k for k in left if tree.query(points[piece == k])[0].min() <= limit_m]
        left = [k for k in left if k not in new]
    return found
