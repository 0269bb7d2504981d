"""Trees with fewer triangles: leaves become rhombs, and of very many some are kept and enlarged.

Catalogue trees model each of some ten thousand leaves with 15 to 50 triangles; from a street two do as well.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Int32

from sbm_gym.assets.models.model import FurnitureModel, Surface

MAX_PIECE_TRIANGLES = 100
"""Connected pieces with more triangles are wood and stay whole; leaves and petals have fewer ..."""
MAX_PIECE_M = 0.7
"""... and are not longer than this along any axis."""
MIN_PIECE_TRIANGLES = 5
"""Leaves of fewer triangles stay as they are."""
MAX_ENLARGEMENT = 2.8
"""Of a leaf's length; beyond, a crown looks like paper."""


def thin_foliage(model: FurnitureModel, max_triangles: int, clear_m: float = 0.0) -> FurnitureModel:
    """Turns leaves into rhombs of the same area, and drops some of them until a tree has about ``max_triangles``.

    Leaves that stay grow to cover what those dropped did. Source: Cook et al., Stochastic Simplification of Aggregate
    Detail, 2007.

    Args:
        model: a tree or bush.
        max_triangles: how many triangles it should have; wood is never dropped.
        clear_m: leaves that hang lower than this are cut, so that people can walk below.

    Returns:
        The model itself if it is small enough.
    """
    if model.num_triangles <= max_triangles and clear_m <= 0.0:
        return model
    crowns = [_split(surface, clear_m) for surface in model.surfaces]
    wood = sum(len(crown.wood) for crown in crowns)
    in_leaves = sum(len(crown.leaves) for crown in crowns)
    share = max((max_triangles - wood) / max(in_leaves, 1), 1.0 / MAX_ENLARGEMENT**2)
    rng = np.random.default_rng(0)
    thinned = [
        _joined(surface, crown, min(share, 1.0), rng) for surface, crown in zip(model.surfaces, crowns, strict=True)
    ]
    return replace(model, surfaces=tuple(surface for surface in thinned if surface is not None))


@dataclass(frozen=True)
class _Crown:
    """A surface's triangles, told apart; leaves that are cut off are in neither part."""

    wood: Int[np.ndarray, "t 3"]
    leaves: Int[np.ndarray, "l 3"]
    shown: Int[np.ndarray, "l 3"]
    """Vertices whose texture coordinates the corners of ``leaves`` have."""
    owner: Int[np.ndarray, "l"]
    """The leaf that each triangle of ``leaves`` belongs to."""
    area_m2: Float[np.ndarray, "n"]
    """What each leaf covers, seen from its front."""


def _split(surface: Surface, clear_m: float) -> _Crown:
    piece = _pieces(surface)
    is_leaf = _are_leaves(surface, piece)
    lowest = np.full(int(piece.max()) + 1, np.inf)
    np.minimum.at(lowest, np.repeat(piece, 3), surface.vertices_m[surface.faces.ravel(), 2])
    kept = is_leaf & (lowest >= clear_m)[piece]
    area_m2 = _cover_m2(surface, piece)
    many = kept & (np.bincount(piece) >= MIN_PIECE_TRIANGLES)[piece]
    rhombs, shown, owner = _rhombs(surface, surface.faces[many], piece[many])
    few = kept & ~many
    return _Crown(
        wood=surface.faces[~is_leaf],
        leaves=np.concatenate([surface.faces[few], rhombs]),
        shown=np.concatenate([surface.faces[few], shown]),
        owner=np.concatenate([piece[few], owner]),
        area_m2=area_m2,
    )


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


def _cover_m2(surface: Surface, piece: Int32[np.ndarray, "t"]) -> Float[np.ndarray, "n"]:
    """Area of each piece from one side: half of its triangles' area where they cover it from both."""
    corner = surface.vertices_m[surface.faces].astype(float)
    cross = 0.5 * np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.bincount(piece, np.linalg.norm(cross, axis=1))
    signed = np.stack([np.bincount(piece, cross[:, axis]) for axis in range(3)], axis=1)
    return np.where(np.linalg.norm(signed, axis=1) > 0.4 * total, total, 0.5 * total)


def _rhombs(
    surface: Surface, faces: Int[np.ndarray, "t 3"], piece: Int32[np.ndarray, "t"]
) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "m 3"], Int[np.ndarray, "m"]]:
    """Two triangles for each piece, between the vertices farthest out along and across it.

    Returns:
        Vertices of the corners; vertices whose texture coordinates the corners take; and the piece of each triangle.
        What a leaf's picture shows beyond the leaf's own outline can be anything, so a rhomb shows the part that the
        leaf's largest triangle does.
    """
    if len(faces) == 0:
        return faces, faces, piece
    used, inverse = np.unique(faces, return_inverse=True)
    of = np.zeros(len(used), np.int64)
    of[inverse.ravel()] = np.repeat(piece, 3)
    points = surface.vertices_m[used].astype(float)
    count = np.maximum(np.bincount(of), 1)
    middle = np.stack([np.bincount(of, points[:, axis]) for axis in range(3)], axis=1) / count[:, None]
    away = points - middle[of]
    spread = np.empty((len(count), 3, 3))
    for i in range(3):
        for j in range(3):
            spread[:, i, j] = np.bincount(of, away[:, i] * away[:, j], len(count))
    _, axes = np.linalg.eigh(spread)
    tips = [_extremes(of, np.einsum("nk,nk->n", away, axes[of, :, axis])) for axis in (2, 1)]
    (base, tip), (left, right) = ((used[low], used[high]) for low, high in tips)
    pieces = np.unique(of)
    corner = surface.vertices_m[faces].astype(float)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    _, largest = _extremes(piece.astype(np.int64), area)
    quads = np.stack([np.stack([base, left, tip], axis=1), np.stack([base, tip, right], axis=1)], axis=1)
    a, b, c = faces[largest].T
    shown = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, b], axis=1)], axis=1)
    return quads.reshape(-1, 3), shown.reshape(-1, 3), np.repeat(pieces, 2)


def _extremes(of: Int[np.ndarray, "v"], value: Float[np.ndarray, "v"]) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the least and greatest value of each group that has any, groups in order."""
    order = np.lexsort((value, of))
    change = np.flatnonzero(np.diff(of[order]))
    return order[np.append(0, change + 1)], order[np.append(change, len(order) - 1)]


def _joined(surface: Surface, crown: _Crown, share: float, rng: np.random.Generator) -> Surface | None:
    """Wood and a share of the leaves, each grown to the area that it has to cover; None if nothing is left."""
    kept = (rng.random(len(crown.area_m2)) < share)[crown.owner]
    leaves, shown, owner = crown.leaves[kept], crown.shown[kept], crown.owner[kept]
    corner = surface.vertices_m[leaves].astype(float)
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    per_leaf = np.bincount(owner, area, len(crown.area_m2))
    # Slivers and leaves seen as folded could ask for any size; none grows beyond what looks like a leaf.
    growth = np.sqrt(crown.area_m2 / np.maximum(per_leaf, 1e-9) / share)
    growth = np.clip(growth, 1.0, 1.3 * MAX_ENLARGEMENT)
    count = np.maximum(np.bincount(owner, minlength=len(growth)), 1)
    middle = np.stack(
        [np.bincount(owner, corner[..., axis].mean(axis=1), len(growth)) / count for axis in range(3)], axis=1
    )
    grown = middle[owner, None] + (corner - middle[owner, None]) * growth[owner, None, None]
    grown[..., 2] = np.maximum(grown[..., 2], 0.0)
    faces = np.concatenate([crown.wood, leaves])
    if len(faces) == 0:
        return None
    # Leaves get vertices of their own, since neighbours that share one would pull at each other.
    corners = np.concatenate([surface.vertices_m[crown.wood], grown.astype(np.float32)]).reshape(-1, 3)
    owners = np.repeat(np.concatenate([np.full(len(crown.wood), -1), owner]), 3)
    shown = np.concatenate([crown.wood, shown]).ravel()
    keys = np.stack([owners, faces.ravel(), shown], axis=1)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return replace(
        surface,
        vertices_m=np.ascontiguousarray(corners[first]),
        normals=surface.normals[faces.ravel()[first]],
        texcoords=None if surface.texcoords is None else surface.texcoords[shown[first]],
        faces=inverse.reshape(-1, 3).astype(np.int32),
    )
