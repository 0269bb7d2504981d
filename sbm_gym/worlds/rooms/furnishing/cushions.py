"""Cushions on couches and beds: dropped onto the real shape of the seat, leaned against the real shape of the back."""

import functools

import numpy as np
from jaxtyping import Float, Float32

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.models.model import FurnitureModel
from sbm_gym.rendering.rays.embree import TriangleTree
from sbm_gym.rendering.rays.workers import Workers
from sbm_gym.worlds.geometry.placing import Layout, Placement, overlap, rotation

STEP_M = 0.02
SEAT_M = (0.22, 0.85)
"""Heights at which one sits or lies."""
SINK_M = 0.012
"""How far a cushion presses into what it lies on; both are soft."""
MOST_SUNK_M = 0.035
"""Likewise beside a steep back or arm, where a little sideways is much in height."""

_ONE_THREAD = Workers(1)


class _Shape:
    """Heights of a model's upper and lower side, by casting vertical rays."""

    def __init__(self, model: FurnitureModel):
        corners = np.concatenate([surface.vertices_m[surface.faces] for surface in model.surfaces], dtype=np.float32)
        self._tree, self._rows, self._high = TriangleTree(corners), np.arange(len(corners)), model.size_m[2] + 1.0

    def top(self, xy_m: Float[np.ndarray, "n 2"]) -> Float32[np.ndarray, "n"]:
        """Height of the upper side, minus infinity beside the model."""
        return self._high - self._cast(xy_m, self._high, -1.0)

    def bottom(self, xy_m: Float[np.ndarray, "n 2"]) -> Float32[np.ndarray, "n"]:
        """Height of the lower side, infinity beside the model."""
        return self._cast(xy_m, -1.0, 1.0) - 1.0

    def _cast(self, xy_m: Float[np.ndarray, "n 2"], start_m: float, way: float) -> Float32[np.ndarray, "n"]:
        rays = np.zeros((len(xy_m), 6), np.float32)
        rays[:, :2], rays[:, 2], rays[:, 5] = xy_m, start_m, way
        return self._tree.cast(rays, self._rows, _ONE_THREAD)[0]


@functools.lru_cache(maxsize=64)
def _shape(library: FurnitureLibrary, card: ModelCard) -> _Shape:
    return _Shape(library.load(card))


@functools.lru_cache(maxsize=256)
def _underside(library: FurnitureLibrary, card: ModelCard) -> tuple[Float[np.ndarray, "n 2"], Float32[np.ndarray, "n"]]:
    """Points of a cushion's underside, a little denser than what it is dropped on is likely to vary."""
    half = np.array(card.size_m[:2]) / 2
    x, y = (np.arange(-h + STEP_M / 2, h, STEP_M) for h in half)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    low = _shape(library, card).bottom(points)
    return points[np.isfinite(low)], low[np.isfinite(low)]


@functools.lru_cache(maxsize=256)
def _skin(library: FurnitureLibrary, card: ModelCard) -> Float32[np.ndarray, "n 3"]:
    """The vertices of a cushion."""
    return np.concatenate([surface.vertices_m for surface in library.load(card).surfaces])


def _sunk_m(shape: _Shape, xy_m: Float[np.ndarray, "n 2"], z_m: Float[np.ndarray, "n"]) -> float:
    """How deep points are below the upper side of what carries them, but for the deepest few."""
    depth = shape.top(xy_m) - z_m
    carried = depth[np.isfinite(depth)]
    return float(np.percentile(carried, 98)) if len(carried) else 0.0


def scatter_cushions(layout: Layout, library: FurnitureLibrary, support: Placement, count: int) -> None:
    """Lays at most ``count`` cushions on a couch or bed: most lean against its back, some lie flat."""
    rng = layout.rng
    for _ in range(count):
        leaning = bool(rng.random() < 0.75)
        cards = library.models("leaning_cushion" if leaning else "cushion")
        if not cards:
            continue
        card = cards[rng.integers(len(cards))]
        for _ in range(6):
            cushion = _drop(library, support, card, leaning, rng)
            if cushion is not None and _is_clear(layout, cushion):
                layout.add(cushion)
                break


def _drop(
    library: FurnitureLibrary, support: Placement, card: ModelCard, leaning: bool, rng: np.random.Generator
) -> Placement | None:
    """Drops a cushion somewhere on a support; None where there is no seat for it."""
    shape = _shape(library, support.card)
    points, low = _underside(library, card)
    half = np.array(support.card.size_m[:2]) / 2
    reach = np.array(card.size_m[:2]) / 2
    if np.any(reach > half - 0.05):
        return None
    x = float(rng.uniform(-1, 1)) * (half[0] - reach[0] - 0.02)
    turn = float(rng.normal(0, 0.12)) if leaning else float(rng.uniform(-np.pi, np.pi))
    turned = points @ rotation(turn).T
    front = -half[1] + reach[1] + 0.04
    back = half[1] - reach[1] - 0.02
    ys = np.arange(front, back, STEP_M) if leaning else np.array([float(rng.uniform(front, back))])
    if len(ys) == 0:
        return None
    places = turned[None] + np.stack([np.full(len(ys), x), ys], axis=1)[:, None]
    top = shape.top(places.reshape(-1, 2)).reshape(len(ys), -1)
    rest = np.max(top - low, axis=1)
    # The seat: where all of the cushion has something even below it.
    even = (top.min(axis=1) > SEAT_M[0]) & (np.ptp(np.where(np.isfinite(top), top, -1.0), axis=1) < 0.07)
    even &= top.max(axis=1) < SEAT_M[1]
    if not even.any():
        return None
    if leaning:
        seat = float(np.median(rest[even]))
        start = int(np.flatnonzero(even)[0])
        # From the front edge of the seat back, until the cushion would have to climb.
        climbs = np.flatnonzero(rest[start:] > seat + 0.02)
        if len(climbs) == 0 or climbs[0] == 0:
            return None  # nothing behind it to lean on
        at = start + int(climbs[0]) - 1
        wall = top[at + 1 : at + 4].max()
        if wall < rest[at] + 0.5 * card.size_m[2]:
            return None  # too low to hold it
        # The underside is sampled: between the samples a steep back or arm may reach further.
        skin = _skin(library, card)
        around = skin[:, :2] @ rotation(turn).T + [x, 0.0]
        while _sunk_m(shape, np.add(around, [0.0, ys[at]]), float(rest[at]) - SINK_M + skin[:, 2]) > MOST_SUNK_M:
            if at == start:
                return None
            at -= 1
    else:
        at = 0
        if np.ptp(top[at]) > 0.05:
            return None
    z = support.z_m + float(rest[at]) - SINK_M
    return Placement(card, *support.at(x, float(ys[at])), support.yaw_rad + turn, z, support)


def _is_clear(layout: Layout, cushion: Placement) -> bool:
    box = cushion.box
    corners = box.corners()
    if np.any(corners < np.array(layout.room.low_m)) or np.any(corners > np.array(layout.room.high_m)):
        return False
    return not any(other is not cushion.on and overlap(box, other.box) for other in layout.placements)
