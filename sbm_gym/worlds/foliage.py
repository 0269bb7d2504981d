"""Trees with fewer leaves: of many leaves some are kept and enlarged, so that a crown stays as dense as it was."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32, Int32

from sbm_gym.assets.model import FurnitureModel, Surface

MAX_PIECE_TRIANGLES = 100
"""Connected pieces with more triangles are wood and stay whole; leaves and petals have fewer ..."""
MAX_PIECE_M = 0.7
"""... and are not longer than this along any axis."""
MAX_ENLARGEMENT = 2.8
"""Of a leaf's length; beyond, a crown looks like paper."""


def thin_foliage(model: FurnitureModel, max_triangles: int, clear_m: float = 0.0) -> FurnitureModel:
    """Drops leaves until a tree has about ``max_triangles``; those that stay grow to cover the same area.

    Source: Cook et al., Stochastic Simplification of Aggregate Detail, 2007.

    Args:
        model: a tree or bush.
        max_triangles: how many triangles it should have; wood is never dropped.
        clear_m: leaves that hang lower than this are cut, so that people can walk below.

    Returns:
        The model itself if it is small enough.
    """
    if model.num_triangles <= max_triangles and clear_m <= 0.0:
        return model
    pieces = [_pieces(surface) for surface in model.surfaces]
    leaves = [_are_leaves(surface, piece) for surface, piece in zip(model.surfaces, pieces, strict=True)]
    wood = sum(int(np.count_nonzero(~is_leaf)) for is_leaf in leaves)
    in_leaves = model.num_triangles - wood
    share = max((max_triangles - wood) / max(in_leaves, 1), 1.0 / MAX_ENLARGEMENT**2)
    share = min(share, 1.0)
    rng = np.random.default_rng(0)
    surfaces = tuple(
        _thin(surface, piece, is_leaf, share, clear_m, rng)
        for surface, piece, is_leaf in zip(model.surfaces, pieces, leaves, strict=True)
    )
    return replace(model, surfaces=surfaces)


def _pieces(surface: Surface) -> Int32[np.ndarray, "t"]:
    """Number of the connected piece that each triangle belongs to; corners at one place are connected."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    keys = np.ascontiguousarray(np.round(surface.vertices_m / 1e-5).astype(np.int64))
    rows = keys.view(np.dtype((np.void, 24))).ravel()
    places, corner = np.unique(rows, return_inverse=True)
    faces = corner.ravel()[surface.faces]
    links = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    graph = coo_array((np.ones(len(links), np.int8), (links[:, 0], links[:, 1])), shape=(len(places), len(places)))
    _, label = connected_components(graph, directed=False)
    _, piece = np.unique(label[faces[:, 0]], return_inverse=True)
    return piece.ravel().astype(np.int32)


def _are_leaves(surface: Surface, piece: Int32[np.ndarray, "t"]) -> Bool[np.ndarray, "t"]:
    """Whether each triangle belongs to a small piece of few triangles."""
    few = np.bincount(piece) <= MAX_PIECE_TRIANGLES
    corners, owner = surface.vertices_m[surface.faces.ravel()], np.repeat(piece, 3)
    low, high = np.full((len(few), 3), np.inf), np.full((len(few), 3), -np.inf)
    np.minimum.at(low, owner, corners)
    np.maximum.at(high, owner, corners)
    return (few & np.all(high - low <= MAX_PIECE_M, axis=1))[piece]


def _thin(surface: Surface, piece, is_leaf, share: float, clear_m: float, rng: np.random.Generator) -> Surface:
    keep = rng.random(int(piece.max()) + 1) < share
    lowest = np.full(len(keep), np.inf)
    np.minimum.at(lowest, np.repeat(piece, 3), surface.vertices_m[surface.faces.ravel(), 2])
    keep &= lowest >= clear_m
    kept = ~is_leaf | keep[piece]
    if not kept.any():
        kept[:] = True
    faces, piece, is_leaf = surface.faces[kept], piece[kept], is_leaf[kept]
    vertices: Float32[np.ndarray, "v 3"] = surface.vertices_m.copy()
    corner, owner = faces[is_leaf].ravel(), np.repeat(piece[is_leaf], 3)
    if len(corner):
        count = np.bincount(owner, minlength=len(keep))
        middle = np.stack([np.bincount(owner, vertices[corner, axis], len(keep)) for axis in range(3)], axis=1)
        middle /= np.maximum(count, 1)[:, None]
        grown = middle[owner] + (vertices[corner] - middle[owner]) / np.sqrt(share)
        grown[:, 2] = np.maximum(grown[:, 2], 0.0)
        vertices[corner] = grown
    used, faces = np.unique(faces, return_inverse=True)
    return replace(
        surface,
        vertices_m=vertices[used],
        normals=surface.normals[used],
        texcoords=None if surface.texcoords is None else surface.texcoords[used],
        faces=faces.reshape(-1, 3).astype(np.int32),
    )
