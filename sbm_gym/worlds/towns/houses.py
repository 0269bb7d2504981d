"""Houses in rows along the streets: storeys with windows, doors, shops with signs and awnings, roofs."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

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
_BOARDS = (
    *(((34, 44, 62), (236, 226, 196)), ((110, 30, 34), (240, 232, 216)), ((230, 224, 208), (52, 46, 44))),
    *(((26, 62, 48), (238, 230, 206)), ((58, 42, 32), (230, 200, 120)), ((30, 30, 32), (236, 236, 232))),
)


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
        corners = house.rect.corners
        for side, (start, end) in enumerate(zip(np.array(corners), np.array(corners[1:] + corners[:1]), strict=True)):
            length = float(np.linalg.norm(end - start))
            facade = Facade(start, (end - start) / length, KERB_M)
            if side in house.street_sides:
                _Front(meshes, house, facade, length, rng).build()
            else:
                meshes.tiled(facade.quads(0.0, length, 0.0, house.eaves_m), house.wall)
        _roof(meshes, house, rng)


@dataclass(frozen=True)
class _Front:
    """A wall that looks onto a street, or a part of one."""

    meshes: StaticMeshes
    house: House
    facade: Facade
    length_m: float
    rng: np.random.Generator

    def build(self) -> None:
        """Adds the whole front: storeys with windows over a shop or flat, and the cornice."""
        house, length, rng = self.house, self.length_m, self.rng
        modern = house.style == "modern"
        window_w = float(rng.uniform(1.6, 2.2)) if modern else float(rng.uniform(1.0, 1.35))
        window_h = min(1.5 if modern else 1.55, house.storey_m - 1.2)
        count = max(int((length - 0.8) / (window_w + float(rng.uniform(0.95, 1.3)))), 1)
        centres = (np.arange(count) + 0.5) * (length / count)
        for storey in range(1, house.storeys):
            floor = house.ground_m + (storey - 1) * house.storey_m
            self._windowed_wall(floor, floor + house.storey_m, centres, window_w, floor + 0.85, window_h)
        if house.shop and length > 5.5:
            self._shop_front()
        else:
            self._ground_floor(centres, window_w)
        self._cornice()

    def _wall(self, *quads: Float[np.ndarray, "q 4 3"]) -> None:
        self.meshes.tiled(np.concatenate(quads), self.house.wall)

    def _windowed_wall(self, low, high, centres, window_w: float, sill: float, window_h: float) -> None:
        """A stretch of wall with a row of windows."""
        left, right, head = centres - window_w / 2, centres + window_w / 2, sill + window_h
        quads = self.facade.quads
        self._wall(
            quads(0.0, self.length_m, low, sill),
            quads(0.0, self.length_m, head, high),
            quads(np.append(0.0, right), np.append(left, self.length_m), sill, head),
            self.facade.reveals(left, right, sill, head, REVEAL_M),
        )
        self._windows(left, right, sill, head)

    def _windows(self, left, right, sill: float, head: float) -> None:
        panes = materials.window_panes()
        chosen = self.rng.integers(len(panes), size=len(left))
        for number, pane in enumerate(panes):
            at = chosen == number
            quads = self.facade.quads(left[at], right[at], sill, head, -REVEAL_M + 0.01)
            self.meshes.pictured(quads, pane, specular=0.6, shininess=0.8)
        deep, front, bar, boxes, style = -REVEAL_M, -REVEAL_M + 0.06, 0.06, self.facade.boxes, self.house.style
        middle = 0.5 * (left + right)
        parts = [
            boxes(left, left + bar, deep, front, sill, head),
            boxes(right - bar, right, deep, front, sill, head),
            boxes(left, right, deep, front, head - bar, head),
            boxes(left, right, deep, front, sill, sill + bar),
            boxes(middle - 0.03, middle + 0.03, deep, front, sill, head),
        ]
        if style in ("brick", "stone"):
            level = sill + 0.55 * (head - sill)
            parts.append(boxes(left, right, deep, front, level - 0.025, level + 0.025))
        self.meshes.plain(np.concatenate(parts), self.house.frame, specular=0.1)
        trim = [boxes(left - 0.08, right + 0.08, deep, 0.07, sill - 0.08, sill)]
        if style == "brick":
            trim.append(boxes(left - 0.12, right + 0.12, 0.0, 0.03, head, head + 0.2))
        if style == "plaster":
            for start, end, foot in ((left - 0.12, left, sill), (right, right + 0.12, sill), (left, right, head)):
                trim.append(boxes(start, end, 0.0, 0.04, foot, head + 0.12))
        self.meshes.plain(np.concatenate(trim), self.house.accent)

    def _ground_floor(self, centres, window_w: float) -> None:
        """A front door between windows, on a plinth."""
        meshes, house, facade, length = self.meshes, self.house, self.facade, self.length_m
        entry = int(self.rng.integers(len(centres)))
        door_w, door_h = 1.05, 2.45
        middle, windows = float(centres[entry]), np.delete(centres, entry)
        low, high = middle - door_w / 2, middle + door_w / 2
        meshes.plain(facade.boxes([0.0, high], [low, length], 0.0, 0.05, 0.0, 0.5), house.accent)
        # The wall is cut in three: beside the door on both sides, and above it.
        for start, end in ((0.0, low - 0.15), (high + 0.15, length)):
            inside = windows[(windows > start) & (windows < end)]
            if end - start < 0.05:
                continue
            fits = (inside - start > window_w / 2 + 0.1) & (end - inside > window_w / 2 + 0.1)
            part = Facade(facade.corner_m + start * facade.along, facade.along, facade.ground_m)
            beside = replace(self, facade=part, length_m=end - start)
            beside._windowed_wall(0.0, house.ground_m, inside[fits] - start, window_w, 0.95, 1.75)
        self._wall(
            facade.quads([low - 0.15, high], [low, high + 0.15], 0.0, house.ground_m),
            facade.quads(low, high, door_h, house.ground_m),
            facade.reveals(low, high, 0.0, door_h, REVEAL_M),
        )
        colour = _DOORS[int(self.rng.integers(len(_DOORS)))]
        meshes.pictured(facade.quads(low, high, 0.12, door_h, -REVEAL_M + 0.01), materials.door(colour), specular=0.2)
        meshes.plain(facade.boxes(low - 0.1, high + 0.1, -REVEAL_M, 0.32, 0.0, 0.12), house.accent)
        meshes.plain(facade.boxes(low - 0.25, high + 0.25, 0.0, 0.4, door_h + 0.12, door_h + 0.2), house.accent)

    def _shop_front(self) -> None:
        """Large windows over a low wall, a glass door, a board with a name, perhaps an awning."""
        meshes, house, facade, length, rng = self.meshes, self.house, self.facade, self.length_m, self.rng
        edge, door_w, head, sill = 0.35, 1.1, 2.75, 0.55
        board = house.ground_m - head - 0.25
        ground, ink = _BOARDS[int(rng.integers(len(_BOARDS)))]
        self._wall(
            facade.quads([0.0, length - edge], [edge, length], 0.0, house.ground_m),
            facade.quads(edge, length - edge, head + board, house.ground_m),
        )
        is_left = rng.random() < 0.5
        door_at = edge if is_left else length - edge - door_w
        first, last = (door_at + door_w, length - edge) if is_left else (edge, door_at)
        cuts = np.linspace(first, last, max(int((last - first) / 2.2), 1) + 1)
        posts = np.append(cuts, door_at if is_left else door_at + door_w)
        door = (door_at, door_at + door_w)
        wood = [
            facade.boxes(first, last, -REVEAL_M, 0.0, 0.0, sill),
            facade.boxes(posts - 0.05, posts + 0.05, -REVEAL_M, 0.02, 0.0, head),
            facade.boxes(edge, length - edge, -REVEAL_M, 0.02, head - 0.08, head),
            facade.boxes(*door, -0.12, -0.08, [0.12, 1.0], [0.22, 1.1]),
            facade.boxes(edge, length - edge, 0.0, 0.08, head, head + board),
        ]
        paint = (ground[0] / 255, ground[1] / 255, ground[2] / 255, 1.0)
        meshes.plain(np.concatenate(wood), paint, specular=0.15)
        trade = list(shops.SHOPS)[int(rng.integers(len(shops.SHOPS)))]
        # Panes show one part of the shop after the other; two shops of one trade hardly ever begin with the same.
        begin = float(rng.uniform())
        glass = [(*ends, sill, -0.1) for ends in itertools.pairwise(cuts.tolist())] + [(*door, 0.12, -0.12)]
        for a0, a1, low, out in glass:
            part = (begin + a0 / shops.WINDOW_M, begin + a1 / shops.WINDOW_M)
            quads = facade.quads(a0, a1, low, head, out)
            meshes.pictured(quads, shops.shop_window(trade), specular=0.6, shininess=0.8, part=part)
        meshes.plain(facade.boxes(*door, -0.2, 0.1, 0.0, 0.12), house.accent)
        wide, middle = min(length - 2 * edge, 7 * board), length / 2
        sign = facade.quads(middle - wide / 2, middle + wide / 2, head, head + board, 0.085)
        meshes.pictured(sign, shops.fascia(trade, ground, ink), specular=0.1)
        if rng.random() < 0.5:
            cloth = shops.awning(_AWNINGS[int(rng.integers(len(_AWNINGS)))])
            a0, a1, low, reach = edge + 0.1, length - edge - 0.1, head - 0.45, 1.25
            slope = facade.points([a0, a1, a1, a0], [reach, reach, 0.09, 0.09], [low, low, head, head])
            hem = facade.quads(a0, a1, head - 0.65, low, reach)
            meshes.pictured(np.concatenate([slope[None], hem]), cloth)

    def _cornice(self) -> None:
        """A moulding under the roof, and one over the ground floor."""
        top, ground = self.house.eaves_m, self.house.ground_m
        mouldings = [(0.18, top - 0.22, top), (0.1, top - 0.4, top - 0.22)]
        if self.house.style in ("stone", "plaster"):
            mouldings.append((0.08, ground - 0.12, ground + 0.06))
        out, low, high = np.transpose(mouldings)
        self.meshes.plain(self.facade.boxes(0.0, self.length_m, 0.0, out, low, high), self.house.accent)


def _roof(meshes: StaticMeshes, house: House, rng: np.random.Generator) -> None:
    r, top = house.rect, house.eaves_m + KERB_M
    if not house.pitched:
        meshes.tiled(flat(r, top), materials.material("felt"))
        wall, rise, coping = 0.25, 0.7, 0.03
        low = np.array([[r.x0, r.y0, top], [r.x0, r.y1 - wall, top], [r.x0, r.y0, top], [r.x1 - wall, r.y0, top]])
        high = np.array(
            [[*xy, top + rise] for xy in ((r.x1, r.y0 + wall), (r.x1, r.y1), (r.x0 + wall, r.y1), (r.x1, r.y1))]
        )
        meshes.tiled(box_quads(low, high), house.wall)
        meshes.boxes(np.add(low, [-coping, -coping, rise]), np.add(high, [coping, coping, 0.07]), house.accent)
        return
    # Given along the ridge (u) and across it (v).
    along_x, over = house.street_sides[0] in (0, 2), 0.35
    (u0, u1), (v0, v1) = ((r.x0, r.x1), (r.y0, r.y1)) if along_x else ((r.y0, r.y1), (r.x0, r.x1))
    half, middle = 0.5 * (v1 - v0), 0.5 * (v0 + v1)
    peak = top + half * float(rng.uniform(0.55, 0.8))
    eaves = top - over * (peak - top) / half
    sides = (v0 - over, v1 + over) if along_x else (v1 + over, v0 - over)
    slopes = [
        [[a, v, eaves], [b, v, eaves], [b, middle, peak], [a, middle, peak]]
        for (a, b), v in zip(((u0, u1), (u1, u0)), sides, strict=True)
    ]
    gables = [[[u, v0, top], [u, v1, top], [u, middle, peak], [u, middle, peak]] for u in (u0, u1)]
    axes = [0, 1, 2] if along_x else [1, 0, 2]
    meshes.tiled(np.array(slopes)[..., axes], materials.roof_tiles(_ROOFS[int(rng.integers(len(_ROOFS)))]))
    meshes.tiled(np.array(gables)[..., axes], house.wall)
    stack = np.array([r.x0 + 0.25 * r.size_m[0], r.y0 + 0.4 * r.size_m[1]])
    chimney = box_quads(np.append(stack - 0.4, top), np.append(stack + 0.4, peak + 0.6))
    meshes.tiled(chimney, materials.material("brick", (112, 66, 56)))
