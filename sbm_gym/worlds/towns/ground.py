"""Roads and pavements of a town: asphalt, markings, kerbs, paving, lawns."""

import itertools

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.static_meshes import StaticMeshes
from sbm_gym.worlds.towns import materials
from sbm_gym.worlds.towns.plan import (
    CORNER_M,
    CROSSING_M,
    KERB_M,
    LANE_M,
    PARKING_M,
    STOP_LINE_M,
    Rect,
    Segment,
    Spawn,
    TownPlan,
)

PAINT = (0.86, 0.86, 0.83, 1.0)
PAINT_M = 0.012
"""Markings lie this far above the asphalt."""
KERB_STONE_M = 0.16
"""Width of a kerb stone."""
_ARC = 6
"""Pieces of a rounded corner."""


def build_ground(meshes: StaticMeshes, plan: TownPlan, rng: np.random.Generator) -> None:
    """Adds everything that one walks and drives on."""
    road = plan.carriageway
    meshes.tiled(flat(road, 0.0), materials.asphalt())
    for block in plan.blocks:
        outline = rounded(block.rect, CORNER_M)
        inner = rounded(block.rect.shrunk(KERB_STONE_M), CORNER_M - KERB_STONE_M)
        _kerb(meshes, outline, inner)
        meshes.tiled(fan(inner, KERB_M), materials.material("paving"))
    _outer_pavement(meshes, plan)
    for segment in plan.segments:
        _markings(meshes, segment)
    for spawn in plan.spawns:
        if spawn.kind in ("bay", "loading", "bus"):
            _bay(meshes, spawn)
    for segment in plan.segments:
        along = rng.uniform(segment.start_m + 6, segment.end_m - 6)
        x, y = segment.street.point(along, rng.choice([-1, 1]) * LANE_M * 0.5)
        cover = Rect(x - 0.45, y - 0.45, x + 0.45, y + 0.45)
        meshes.pictured(flat(cover, 0.5 * PAINT_M), materials.manhole(), specular=0.2)


def flat(rect: Rect, z_m: float) -> Float[np.ndarray, "1 4 3"]:
    """A level rectangle seen from above."""
    return np.array([[[x, y, z_m] for x, y in rect.corners]])


def rounded(rect: Rect, radius_m: float) -> Float[np.ndarray, "n 2"]:
    """Outline of a rectangle with round corners, counter-clockwise."""
    points = []
    corners = ((rect.x1, rect.y0), (rect.x1, rect.y1), (rect.x0, rect.y1), (rect.x0, rect.y0))
    for quarter, (x, y) in enumerate(corners):
        inward = np.array([np.sign(0.5 * (rect.x0 + rect.x1) - x), np.sign(0.5 * (rect.y0 + rect.y1) - y)])
        centre = np.array([x, y]) + radius_m * inward
        angles = 0.5 * np.pi * (quarter - 1 + np.arange(_ARC + 1) / _ARC)
        points.append(centre + radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1))
    return np.concatenate(points)


def fan(outline: Float[np.ndarray, "n 2"], z_m: float) -> Float[np.ndarray, "n 4 3"]:
    """A convex polygon as triangles around its middle."""
    after = np.roll(outline, -1, axis=0)
    middle = np.broadcast_to(outline.mean(axis=0), outline.shape)
    plan = np.stack([middle, outline, after, after], axis=1)
    return np.concatenate([plan, np.full((*plan.shape[:2], 1), z_m)], axis=2)


def _kerb(meshes: StaticMeshes, outline: Float[np.ndarray, "n 2"], inner: Float[np.ndarray, "n 2"]) -> None:
    """Kerb stones along an outline: their faces to the road and their tops."""
    a, b = outline, np.roll(outline, -1, axis=0)
    c, d = np.roll(inner, -1, axis=0), inner
    low, high = np.zeros((len(a), 1)), np.full((len(a), 1), KERB_M)
    face = np.stack([np.hstack(v) for v in ((a, low), (b, low), (b, high), (a, high))], axis=1)
    top = np.stack([np.hstack(v) for v in ((a, high), (b, high), (c, high), (d, high))], axis=1)
    meshes.tiled(np.concatenate([face, top]), materials.material("concrete"))


def _outer_pavement(meshes: StaticMeshes, plan: TownPlan) -> None:
    """The pavement around the ring, before the outermost houses."""
    road, outer = plan.carriageway, plan.walkable
    kerb = road.shrunk(-KERB_STONE_M)
    for rect in _frame(kerb, outer):
        meshes.tiled(flat(rect, KERB_M), materials.material("paving"))
    for rect in _frame(road, kerb):
        meshes.tiled(flat(rect, KERB_M), materials.material("concrete"))
    corners = np.array([(road.x0, road.y0), (road.x0, road.y1), (road.x1, road.y1), (road.x1, road.y0)])
    for a, b in itertools.pairwise([*corners, corners[0]]):
        meshes.tiled(np.array([[[*a, 0.0], [*b, 0.0], [*b, KERB_M], [*a, KERB_M]]]), materials.material("concrete"))


def _frame(a: Rect, b: Rect) -> list[Rect]:
    """Four strips that fill rectangle ``b`` around rectangle ``a``."""
    return [
        Rect(b.x0, b.y0, b.x1, a.y0),
        Rect(b.x0, a.y1, b.x1, b.y1),
        Rect(b.x0, a.y0, a.x0, a.y1),
        Rect(a.x1, a.y0, b.x1, a.y1),
    ]


def _stripe(segment: Segment, a0: float, a1: float, t0: float, t1: float) -> Float[np.ndarray, "4 3"]:
    """A painted rectangle given along and across a street."""
    p, q = segment.street.point(a0, t0), segment.street.point(a1, t1)
    low, high = np.minimum(p, q), np.maximum(p, q)
    return flat(Rect(*low, *high), PAINT_M)[0]


def _markings(meshes: StaticMeshes, segment: Segment) -> None:
    """Centre line, stop lines, zebra crossings, arrows."""
    street = segment.street
    start = segment.start_m + (STOP_LINE_M if segment.stops[0] else 1.0)
    end = segment.end_m - (STOP_LINE_M if segment.stops[1] else 1.0)
    quads = [_stripe(segment, at, at + 2.5, -0.06, 0.06) for at in np.arange(start + 1.0, end - 2.5, 4.5)]
    high, low = street.half_m[0], -street.half_m[1]
    for is_end in (False, True):
        if not segment.stops[int(is_end)]:
            continue
        edge, inward = (segment.end_m, -1.0) if is_end else (segment.start_m, 1.0)
        side = street.right_side(is_end)
        stop = (edge + inward * STOP_LINE_M, edge + inward * (STOP_LINE_M + 0.4))
        quads.append(_stripe(segment, *stop, 0.1 * side, LANE_M * side))
        zebra = (edge + inward * CROSSING_M[0], edge + inward * CROSSING_M[1])
        quads += [_stripe(segment, *zebra, t, t + 0.5) for t in np.arange(low + 0.35, high - 0.45, 1.0)]
        quads += _arrow(segment, edge + inward * (STOP_LINE_M + 7.5), -inward, side * LANE_M / 2)
    meshes.plain(np.stack(quads), PAINT)


def _arrow(segment: Segment, tail_m: float, towards: float, across_m: float) -> list[Float[np.ndarray, "4 3"]]:
    """A straight arrow on a lane."""
    shaft = _stripe(segment, tail_m, tail_m + towards * 1.6, across_m - 0.07, across_m + 0.07)
    point = segment.street.point
    left, right = point(tail_m + towards * 1.6, across_m - 0.28), point(tail_m + towards * 1.6, across_m + 0.28)
    tip = point(tail_m + towards * 2.6, across_m)
    turn = (right - left)[0] * (tip - left)[1] - (right - left)[1] * (tip - left)[0]
    first, second = (left, right) if turn > 0 else (right, left)
    return [shaft, np.array([[*p, PAINT_M] for p in (first, second, tip, tip)])]


def _bay(meshes: StaticMeshes, spawn: Spawn) -> None:
    """White lines at both ends of a parking bay, and one along the lane."""
    ahead, middle = spawn.ahead, spawn.middle_m
    left = np.array([-ahead[1], ahead[0]])
    half_length, half_width = spawn.length_m / 2, spawn.width_m / 2
    if spawn.width_m == PARKING_M:  # beside a street
        lines = [(s * half_length, s * half_length, -half_width, half_width, 0.05, 0.0) for s in (-1, 1)]
        lines.append((-half_length, half_length, half_width, half_width, 0.0, 0.05))
    else:
        lines = [(-half_length, half_length, s * half_width, s * half_width, 0.0, 0.05) for s in (-1, 1)]
    quads = []
    for a0, a1, t0, t1, da, dt in lines:
        corners = ((a0 - da, t0 - dt), (a1 + da, t0 - dt), (a1 + da, t1 + dt), (a0 - da, t1 + dt))
        height = spawn.z_m + PAINT_M
        quads.append([[*(middle + a * ahead + t * left), height] for a, t in corners])
    meshes.plain(np.array(quads), PAINT)
