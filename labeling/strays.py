"""Points of a segment that lie apart from it: noise of depth and pose, not parts of the object."""

import numpy as np
from jaxtyping import Bool, Float32, Int32

MAX_CELLS = 4_000_000


def stray_points(
    points: Float32[np.ndarray, "n 3"],
    object_of_point: Int32[np.ndarray, "n"],
    num_objects: int,
    gap_m: float,
    min_share: float,
) -> Bool[np.ndarray, "n"]:
    """Points in pieces of their object that hold less than a share of it.

    Args:
        points: world points, metres.
        object_of_point: index of the object, -1 for none.
        num_objects: how many objects there are.
        gap_m: pieces nearer to each other than about this are one piece.
        min_share: pieces with less than this share of the object's points are strays. An object that another one
            hides in part falls into a few large pieces: these stay.

    Returns:
        Whether each point is a stray.
    """
    from scipy import ndimage

    strays = np.zeros(len(points), bool)
    for k in range(num_objects):
        members = np.flatnonzero(object_of_point == k)
        if len(members) == 0:
            continue
        own = points[members]
        low, edge = own.min(axis=0), gap_m
        # A cloud with points far apart would need a huge grid: coarser cells only join more pieces.
        while np.prod(np.ceil((own.max(axis=0) - low) / edge) + 1) > MAX_CELLS:
            edge *= 2
        cell = np.floor((own - low) / edge).astype(int)
        grid = np.zeros(cell.max(axis=0) + 1, bool)
        grid[tuple(cell.T)] = True
        pieces = np.zeros(grid.shape, np.int32)
        ndimage.label(grid, structure=np.ones((3, 3, 3)), output=pieces)
        piece = pieces[tuple(cell.T)]
        size = np.bincount(piece)
        small = size < min_share * len(members)
        small[size.argmax()] = False
        strays[members[small[piece]]] = True
    return strays
