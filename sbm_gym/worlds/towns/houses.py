"""Houses in rows along the streets: storeys with windows, doors, shops with signs and awnings, roofs."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from sbm_gym.assets.models.surfaces import Material
from sbm_gym.worlds.static_meshes import Facade, Rgba, StaticMeshes, box_quads
from sbm_gym.worlds.towns import materials, shops
from sbm_gym.worlds.towns.ground import flat
from sbm_gym.worlds.towns.plan import HOUSE_DEPTH_M, KERB_M, PAVEMENT_M, Rect, TownPlan

REVEAL_M = 0.16
"""How deep windows lie in the wall."""
STYLES = ("brick", "plaster", "stone", "modern")
_ROOFS = ((142, 78, 58), (96, 92, 96), (120, 84, 70))
_DOORS = ((44, 60, 88), (96, 34, 34), (38, 66, 50), (52, 46, 42), (150, 120, 70))
_AWNINGS = ((168, 40, 44), (36, 84, 64), (40, 66, 120), (196, 140, 44))
_BOARDS = (((34, 44, 62), (236, 226, 196)), ((110, 30, 34), (240, 232, 216)), ((230, 224, 208), (52, 46, 44)))
_BOARDS_DARK = (((26, 62, 48), (238, 230, 206)), ((58, 42, 32), (230, 200, 120)), ((30, 30, 32), (236, 236, 232)))


@dataclass(frozen=True)
class House:
    """One house of a row."""

    rect: Rect
    street_sides: tuple[int, ...]
    """Which of its walls look onto a street: 0 south, 1 east, 2 north, 3 west."""
    style: str
    storeys: int
    ground_m: float
    """Height of the ground floor's ceiling above its floor."""
    storey_m: float
    wall: Material
    accent: Rgba
    """Sills, lintels, cornice."""
    frame: Rgba
    """Window frames."""
    pitched: bool
    shop: bool

    @property
    def eaves_m(self) -> float:
        """Height of the walls."""
        return self.ground_m + (self.storeys - 1) * self.storey_m


def house_rows(plan: TownPlan, rng: np.random.Generator) -> list[House]:
    """Draws all houses: around the blocks built over, and beyond the ring."""
    houses: list[House] = []
    for block in plan.blocks:
        if block.kind == "houses":
            houses += _around(block.rect.shrunk(PAVEMENT_M), rng)
    inner, outer = plan.walkable, plan.whole
    houses += _row(Rect(outer.x0, outer.y0, outer.x1, inner.y0), 0, (2,), rng)
    houses += _row(Rect(outer.x0, inner.y1, outer.x1, outer.y1), 0, (0,), rng)
    houses += _row(Rect(outer.x0, inner.y0, inner.x0, inner.y1), 1, (1,), rng)
    houses += _row(Rect(inner.x1, inner.y0, outer.x1, inner.y1), 1, (3,), rng)
    return houses


def _around(land: Rect, rng: np.random.Generator) -> list[House]:
    """Houses on all sides of a block; those at corners look both ways."""
    width, height = land.size_m
    depth = min(HOUSE_DEPTH_M, 0.5 * min(width, height))
    houses = []
    if height - 2 * depth < 4.0:
        depth = height / 2
    for side, (y0, y1) in ((0, (land.y0, land.y0 + depth)), (2, (land.y1 - depth, land.y1))):
        houses += _row(Rect(land.x0, y0, land.x1, y1), 0, (side,), rng, ends=(3, 1))
    if height - 2 * depth >= 4.0:
        y0, y1 = land.y0 + depth, land.y1 - depth
        houses += _row(Rect(land.x0, y0, land.x0 + depth, y1), 1, (3,), rng)
        houses += _row(Rect(land.x1 - depth, y0, land.x1, y1), 1, (1,), rng)
    return houses


def _row(
    land: Rect, axis: int, sides: tuple[int, ...], rng: np.random.Generator, ends: tuple[int, int] | None = None
) -> list[House]:
    """A terrace that fills a strip of land, split along ``axis``."""
    length = land.size_m[axis]
    count = max(round(length / rng.uniform(9.5, 13.0)), 1)
    shares = rng.uniform(0.75, 1.25, count)
    cuts = np.concatenate([[0.0], np.cumsum(shares / shares.sum())]) * length
    houses = []
    for k in range(count):
        if axis == 0:
            rect = Rect(land.x0 + cuts[k], land.y0, land.x0 + cuts[k + 1], land.y1)
        else:
            rect = Rect(land.x0, land.y0 + cuts[k], land.x1, land.y0 + cuts[k + 1])
        looks = sides
        if ends is not None:
            looks += ((ends[0],) if k == 0 else ()) + ((ends[1],) if k == count - 1 else ())
        houses.append(_house(rect, looks, rng))
    return houses


def _house(rect: Rect, street_sides: tuple[int, ...], rng: np.random.Generator) -> House:
    style = STYLES[rng.choice(4, p=[0.32, 0.36, 0.16, 0.16])]
    walls = materials.wall_materials(style)
    accents = ((0.80, 0.77, 0.70, 1.0), (0.88, 0.87, 0.84, 1.0), (0.62, 0.58, 0.52, 1.0))
    frames = ((0.92, 0.92, 0.90, 1.0), (0.30, 0.24, 0.20, 1.0), (0.20, 0.24, 0.24, 1.0), (0.86, 0.84, 0.78, 1.0))
    modern = style == "modern"
    return House(
        rect=rect,
        street_sides=street_sides,
        style=style,
        storeys=int(rng.integers(2, 5)),
        ground_m=float(rng.uniform(3.5, 4.0)),
        storey_m=float(rng.uniform(2.9, 3.2)),
        wall=walls[int(rng.integers(len(walls)))],
        accent=accents[int(rng.integers(3))],
        frame=(0.16, 0.17, 0.18, 1.0) if modern else frames[int(rng.integers(4))],
        pitched=bool(not modern and rng.random() < 0.5),
        shop=bool(rng.random() < 0.45),
    )


def build_houses(meshes: StaticMeshes, houses: list[House], rng: np.random.Generator) -> None:
    """Adds what is seen of the houses."""
    for house in houses:
        for side in range(4):
            facade, length = _facade(house.rect, side)
            if side in house.street_sides:
                _street_front(meshes, house, facade, length, rng)
            else:
                meshes.tiled(facade.quads(0.0, length, 0.0, house.eaves_m), house.wall)
        _roof(meshes, house, rng)


def _facade(rect: Rect, side: int) -> tuple[Facade, float]:
    start, end = np.array(rect.corners[side]), np.array(rect.corners[(side + 1) % 4])
    length = float(np.linalg.norm(end - start))
    return Facade(start, (end - start) / length, KERB_M), length


def _street_front(meshes: StaticMeshes, house: House, facade: Facade, length: float, rng: np.random.Generator) -> None:
    window_w = float(rng.uniform(1.0, 1.35)) if house.style != "modern" else float(rng.uniform(1.6, 2.2))
    window_h = min(1.55 if house.style != "modern" else 1.5, house.storey_m - 1.2)
    count = max(int((length - 0.8) / (window_w + float(rng.uniform(0.95, 1.3)))), 1)
    centres = (np.arange(count) + 0.5) * (length / count)
    for storey in range(1, house.storeys):
        floor = house.ground_m + (storey - 1) * house.storey_m
        sill = floor + 0.85
        _windowed_wall(
            meshes, house, facade, length, floor, floor + house.storey_m, centres, window_w, sill, window_h, rng
        )
    if house.shop and length > 5.5:
        _shop_front(meshes, house, facade, length, rng)
    else:
        _ground_floor(meshes, house, facade, length, centres, window_w, rng)
    _cornice(meshes, house, facade, length)


def _windowed_wall(
    meshes, house: House, facade: Facade, length, low, high, centres, window_w, sill, window_h, rng
) -> None:
    """A stretch of wall with a row of windows."""
    left, right, head = centres - window_w / 2, centres + window_w / 2, sill + window_h
    meshes.tiled(facade.quads(0.0, length, low, sill), house.wall)
    meshes.tiled(facade.quads(0.0, length, head, high), house.wall)
    meshes.tiled(facade.quads(np.append(0.0, right), np.append(left, length), sill, head), house.wall)
    meshes.tiled(facade.reveals(left, right, sill, head, REVEAL_M), house.wall)
    _windows(meshes, house, facade, left, right, sill, head, rng)


def _windows(
    meshes, house: House, facade: Facade, left, right, sill: float, head: float, rng: np.random.Generator
) -> None:
    panes = materials.window_panes()
    chosen = rng.integers(len(panes), size=len(left))
    for number, pane in enumerate(panes):
        at = chosen == number
        if at.any():
            quads = facade.quads(left[at], right[at], sill, head, -REVEAL_M + 0.01)
            meshes.pictured(quads, pane, specular=0.6, shininess=0.8)
    deep, front, bar = -REVEAL_M, -REVEAL_M + 0.06, 0.06
    parts = [
        facade.boxes(left, left + bar, deep, front, sill, head),
        facade.boxes(right - bar, right, deep, front, sill, head),
        facade.boxes(left, right, deep, front, head - bar, head),
        facade.boxes(left, right, deep, front, sill, sill + bar),
        facade.boxes(0.5 * (left + right) - 0.03, 0.5 * (left + right) + 0.03, deep, front, sill, head),
    ]
    if house.style in ("brick", "stone"):
        level = sill + 0.55 * (head - sill)
        parts.append(facade.boxes(left, right, deep, front, level - 0.025, level + 0.025))
    meshes.plain(np.concatenate(parts), house.frame, specular=0.1)
    trim = [facade.boxes(left - 0.08, right + 0.08, -REVEAL_M, 0.07, sill - 0.08, sill)]
    if house.style == "brick":
        trim.append(facade.boxes(left - 0.12, right + 0.12, 0.0, 0.03, head, head + 0.2))
    if house.style == "plaster":
        trim += [
            facade.boxes(left - 0.12, left, 0.0, 0.04, sill, head + 0.12),
            facade.boxes(right, right + 0.12, 0.0, 0.04, sill, head + 0.12),
            facade.boxes(left, right, 0.0, 0.04, head, head + 0.12),
        ]
    meshes.plain(np.concatenate(trim), house.accent)


def _ground_floor(
    meshes: StaticMeshes,
    house: House,
    facade: Facade,
    length: float,
    centres,
    window_w: float,
    rng: np.random.Generator,
) -> None:
    """A front door between windows, on a plinth."""
    entry = int(rng.integers(len(centres)))
    door_w, door_h = 1.05, 2.45
    middle = float(centres[entry])
    windows = np.delete(centres, entry)
    meshes.plain(facade.boxes(0.0, middle - door_w / 2, 0.0, 0.05, 0.0, 0.5), house.accent)
    meshes.plain(facade.boxes(middle + door_w / 2, length, 0.0, 0.05, 0.0, 0.5), house.accent)
    # The wall is cut in three: beside the door on both sides, and above it.
    for start, end in ((0.0, middle - door_w / 2 - 0.15), (middle + door_w / 2 + 0.15, length)):
        inside = windows[(windows > start) & (windows < end)]
        part = Facade(facade.corner_m + start * facade.along, facade.along, facade.ground_m)
        if end - start < 0.05:
            continue
        fits = (inside - start > window_w / 2 + 0.1) & (end - inside > window_w / 2 + 0.1)
        _windowed_wall(
            meshes, house, part, end - start, 0.0, house.ground_m, inside[fits] - start, window_w, 0.95, 1.75, rng
        )
    low, high = middle - door_w / 2, middle + door_w / 2
    meshes.tiled(facade.quads([low - 0.15, high], [low, high + 0.15], 0.0, house.ground_m), house.wall)
    meshes.tiled(facade.quads(low, high, door_h, house.ground_m), house.wall)
    meshes.tiled(facade.reveals(low, high, 0.0, door_h, REVEAL_M), house.wall)
    colour = _DOORS[int(rng.integers(len(_DOORS)))]
    meshes.pictured(facade.quads(low, high, 0.12, door_h, -REVEAL_M + 0.01), materials.door(colour), specular=0.2)
    meshes.plain(facade.boxes(low - 0.1, high + 0.1, -REVEAL_M, 0.32, 0.0, 0.12), house.accent)
    meshes.plain(facade.boxes(low - 0.25, high + 0.25, 0.0, 0.4, door_h + 0.12, door_h + 0.2), house.accent)


def _shop_front(meshes: StaticMeshes, house: House, facade: Facade, length: float, rng: np.random.Generator) -> None:
    """Large windows over a low wall, a glass door, a board with a name, perhaps an awning."""
    edge, door_w, head, sill = 0.35, 1.1, 2.75, 0.55
    board = house.ground_m - head - 0.25
    colours = (*_BOARDS, *_BOARDS_DARK)
    ground, ink = colours[int(rng.integers(len(colours)))]
    paint = (ground[0] / 255, ground[1] / 255, ground[2] / 255, 1.0)
    meshes.tiled(facade.quads([0.0, length - edge], [edge, length], 0.0, house.ground_m), house.wall)
    meshes.tiled(facade.quads(edge, length - edge, head + board, house.ground_m), house.wall)
    door_at = edge if rng.random() < 0.5 else length - edge - door_w
    first, last = (door_at + door_w, length - edge) if door_at == edge else (edge, door_at)
    count = max(int((last - first) / 2.2), 1)
    cuts = np.linspace(first, last, count + 1)
    meshes.plain(facade.boxes(first, last, -REVEAL_M, 0.0, 0.0, sill), paint, specular=0.15)
    trade = list(shops.SHOPS)[int(rng.integers(len(shops.SHOPS)))]
    picture = shops.shop_window(trade)
    glass: dict[str, Any] = {"picture": picture, "specular": 0.6, "shininess": 0.8}
    # GlassHits show one part of the shop after the other; two shops of one trade hardly ever begin with the same.
    begin = float(rng.uniform())
    for a0, a1 in [(float(a), float(b)) for a, b in itertools.pairwise(cuts)]:
        part = (begin + a0 / shops.WINDOW_M, begin + a1 / shops.WINDOW_M)
        meshes.pictured(facade.quads(a0, a1, sill, head, -0.1), part=part, **glass)
    posts = np.append(cuts, door_at if door_at == edge else door_at + door_w)
    meshes.plain(facade.boxes(posts - 0.05, posts + 0.05, -REVEAL_M, 0.02, 0.0, head), paint, specular=0.15)
    meshes.plain(facade.boxes(edge, length - edge, -REVEAL_M, 0.02, head - 0.08, head), paint, specular=0.15)
    part = (begin + door_at / shops.WINDOW_M, begin + (door_at + door_w) / shops.WINDOW_M)
    meshes.pictured(facade.quads(door_at, door_at + door_w, 0.12, head, -0.12), part=part, **glass)
    rails = [facade.boxes(door_at, door_at + door_w, -0.12, -0.08, z, z + 0.1) for z in (0.12, 1.0)]
    meshes.plain(np.concatenate(rails), paint, specular=0.15)
    meshes.plain(facade.boxes(door_at, door_at + door_w, -0.2, 0.1, 0.0, 0.12), house.accent)
    meshes.plain(facade.boxes(edge, length - edge, 0.0, 0.08, head, head + board), paint, specular=0.15)
    wide = min(length - 2 * edge, 7 * board)
    middle = length / 2
    sign = facade.quads(middle - wide / 2, middle + wide / 2, head, head + board, 0.085)
    meshes.pictured(sign, shops.fascia(trade, ground, ink), specular=0.1)
    if rng.random() < 0.5:
        cloth = shops.awning(_AWNINGS[int(rng.integers(len(_AWNINGS)))])
        p, reach = facade.points, 1.25
        a0, a1 = edge + 0.1, length - edge - 0.1
        slope = [p(a0, reach, head - 0.45), p(a1, reach, head - 0.45), p(a1, 0.09, head), p(a0, 0.09, head)]
        hem = [
            p(a0, reach, head - 0.65),
            p(a1, reach, head - 0.65),
            p(a1, reach, head - 0.45),
            p(a0, reach, head - 0.45),
        ]
        meshes.pictured(np.array([slope, hem]), cloth)


def _cornice(meshes: StaticMeshes, house: House, facade: Facade, length: float) -> None:
    """A moulding under the roof, and one over the ground floor."""
    top = house.eaves_m
    parts = [
        facade.boxes(0.0, length, 0.0, 0.18, top - 0.22, top),
        facade.boxes(0.0, length, 0.0, 0.1, top - 0.4, top - 0.22),
    ]
    if house.style in ("stone", "plaster"):
        parts.append(facade.boxes(0.0, length, 0.0, 0.08, house.ground_m - 0.12, house.ground_m + 0.06))
    meshes.plain(np.concatenate(parts), house.accent)


def _roof(meshes: StaticMeshes, house: House, rng: np.random.Generator) -> None:
    r, top = house.rect, house.eaves_m + KERB_M
    width, depth = r.size_m
    if not house.pitched:
        meshes.tiled(flat(r, top), materials.material("felt"))
        wall, rise = 0.25, 0.7
        low = [[r.x0, r.y0, top], [r.x0, r.y1 - wall, top], [r.x0, r.y0, top], [r.x1 - wall, r.y0, top]]
        high = [[r.x1, r.y0 + wall], [r.x1, r.y1], [r.x0 + wall, r.y1], [r.x1, r.y1]]
        meshes.tiled(box_quads(np.array(low), np.array([[*h, top + rise] for h in high])), house.wall)
        coping = 0.03
        meshes.boxes(
            np.add(low, [-coping, -coping, rise]),
            np.array([[h[0] + coping, h[1] + coping, top + rise + 0.07] for h in high]),
            house.accent,
        )
        return
    along_x = house.street_sides[0] in (0, 2)
    span = depth if along_x else width
    peak = top + 0.5 * span * float(rng.uniform(0.55, 0.8))
    over = 0.35
    tiles = materials.roof_tiles(_ROOFS[int(rng.integers(len(_ROOFS)))])
    drop = over * (peak - top) / (0.5 * span)
    if along_x:
        y = 0.5 * (r.y0 + r.y1)
        slopes = [
            [[r.x0, r.y0 - over, top - drop], [r.x1, r.y0 - over, top - drop], [r.x1, y, peak], [r.x0, y, peak]],
            [[r.x1, r.y1 + over, top - drop], [r.x0, r.y1 + over, top - drop], [r.x0, y, peak], [r.x1, y, peak]],
        ]
        gables = [[[x, r.y0, top], [x, r.y1, top], [x, y, peak], [x, y, peak]] for x in (r.x0, r.x1)]
    else:
        x = 0.5 * (r.x0 + r.x1)
        slopes = [
            [[r.x1 + over, r.y0, top - drop], [r.x1 + over, r.y1, top - drop], [x, r.y1, peak], [x, r.y0, peak]],
            [[r.x0 - over, r.y1, top - drop], [r.x0 - over, r.y0, top - drop], [x, r.y0, peak], [x, r.y1, peak]],
        ]
        gables = [[[r.x0, y, top], [r.x1, y, top], [x, y, peak], [x, y, peak]] for y in (r.y0, r.y1)]
    meshes.tiled(np.array(slopes), tiles)
    meshes.tiled(np.array(gables), house.wall)
    stack = np.array([r.x0 + 0.25 * width, r.y0 + 0.4 * depth])
    chimney = box_quads(np.array([[*(stack - 0.4), top]]), np.array([[*(stack + 0.4), peak + 0.6]]))
    meshes.tiled(chimney, materials.material("brick", (112, 66, 56)))
