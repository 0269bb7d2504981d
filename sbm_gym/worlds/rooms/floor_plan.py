"""Floor plans: rooms of several kinds in one rectangle, joined by doorways that one can walk through."""

import itertools
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.geometry.placing import Opening, Room
from sbm_gym.worlds.rooms.doors import hang_leaves

INNER_WALL_M = 0.12
"""Thickness of the walls between rooms."""
OUTER_WALL_M = 0.2
DOORWAY_HEIGHT_M = 2.05
CORNER_M = 0.16
"""Wall that stays between a doorway and the corner of a room."""
ATTEMPTS = 3000
"""How often walls are drawn until every room has its shape and its neighbours."""
Rectangle = tuple[float, float, float, float]
"""min x, min y, max x, max y"""


@dataclass(frozen=True)
class RoomKind:
    """What a kind of room asks of its walls, and what it has."""

    area_m2: tuple[float, float]
    min_side_m: float
    max_aspect: float = 2.0
    public: bool = False
    """Whether one walks through it to other rooms."""
    windows: tuple[int, int] = (1, 2)
    """How many, where it has outer walls."""
    needed: tuple[str, ...] = ()
    """Classes without which a room is not of its kind."""
    expected: tuple[str, ...] = ()
    """Uses without a class that it should have too."""
    extras: tuple[str, ...] = ()
    """What it may be filled up with, see ``furnishing.extras.fill``."""
    pictures: int = 4
    """The most that hang on its walls."""
    floors: tuple[str, ...] = ("",)
    """What may cover its floor, functions of ``assets.models.surfaces``; "" is what the home has everywhere."""
    walls: tuple[str, ...] = ("", "plaster", "wallpaper")
    """Likewise its walls."""
    curtains: bool = True
    """Whether its windows may have them."""


_TABLES = tomllib.loads(Path(__file__).with_name("rooms.toml").read_text(encoding="utf-8"))
ROOM_KINDS: dict[str, RoomKind] = {}
for _kind, _entry in _TABLES["rooms"].items():
    _fields: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in _entry.items()}
    ROOM_KINDS[_kind] = RoomKind(**_fields)
PROGRAMMES: dict[str, list[list[str]]] = _TABLES["homes"]
"""Which rooms a kind of home has; one programme is drawn."""


@dataclass(frozen=True)
class Passage:
    """An opening in the wall between two rooms; its leaf, if it has one, stands open in one of them."""

    rooms: tuple[int, int]
    rectangle: Rectangle
    """The floor within the wall."""

    @property
    def middle_m(self) -> Float[np.ndarray, "2"]:
        """The middle of its floor."""
        x0, y0, x1, y1 = self.rectangle
        return np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)])

    def through(self, reach_m: float) -> Rectangle:
        """Its floor and as much beyond on both sides of the wall."""
        x0, y0, x1, y1 = self.rectangle
        if x1 - x0 < y1 - y0:  # doorways are wider than walls are thick
            return x0 - reach_m, y0, x1 + reach_m, y1
        return x0, y0 - reach_m, x1, y1 + reach_m


@dataclass(frozen=True)
class FloorPlan:
    """Rooms and the passages between them."""

    rooms: tuple[Room, ...]
    passages: tuple[Passage, ...]
    bounds: Rectangle
    """All rooms and the outer walls."""

    def open_rectangles(self) -> list[Rectangle]:
        """Floor that one can walk on: rooms and passages."""
        rooms = [(*room.low_m, *room.high_m) for room in self.rooms]
        return rooms + [passage.rectangle for passage in self.passages]

    def solid_rectangles(self) -> list[Rectangle]:
        """Walls: rectangles that together with the open ones tile the bounds."""
        return complement(self.open_rectangles(), self.bounds)


def complement(holes: Sequence[Rectangle], bounds: Rectangle) -> list[Rectangle]:
    """Rectangles that cover ``bounds`` but for the holes: cells between all edges, merged where they line up."""
    xs = np.unique(np.round([bounds[0], bounds[2], *(x for hole in holes for x in (hole[0], hole[2]))], 6))
    ys = np.unique(np.round([bounds[1], bounds[3], *(y for hole in holes for y in (hole[1], hole[3]))], 6))
    middle_x, middle_y = 0.5 * (xs[1:] + xs[:-1]), 0.5 * (ys[1:] + ys[:-1])
    solid = np.ones((len(middle_y), len(middle_x)), bool)
    for x0, y0, x1, y1 in holes:
        solid &= ~(((middle_y > y0) & (middle_y < y1))[:, None] & ((middle_x > x0) & (middle_x < x1))[None])
    found: list[Rectangle] = []
    while solid.any():
        i, j = np.argwhere(solid)[0]
        wide = int(np.argmin(np.append(solid[i, j:], False)))
        tall = int(np.argmin(np.append(solid[i:, j], False)))
        # The longer way first, so that walls come as few long boxes.
        if xs[j + wide] - xs[j] >= ys[i + tall] - ys[i]:
            tall = int(np.argmin(np.append(solid[i:, j : j + wide].all(axis=1), False)))
        else:
            wide = int(np.argmin(np.append(solid[i : i + tall, j:].all(axis=0), False)))
        solid[i : i + tall, j : j + wide] = False
        found.append((float(xs[j]), float(ys[i]), float(xs[j + wide]), float(ys[i + tall])))
    return found


def draw_plan(kind: str, rng: np.random.Generator) -> FloorPlan:
    """Draws a floor plan.

    Args:
        kind: of home, a key of ``PROGRAMMES``.
        rng: source of randomness.

    Returns:
        A plan in which every room can be reached from every other; its middle is the origin.
    """
    programmes = PROGRAMMES[kind]
    height = float(np.round(rng.uniform(2.5, 2.8), 2))
    for _ in range(ATTEMPTS):
        rooms = programmes[rng.integers(len(programmes))]
        areas = np.array([rng.uniform(*ROOM_KINDS[room].area_m2) for room in rooms])
        # Two rows of rooms with a hall between are about as deep in every home; other homes are compact.
        corridor = kind == "apartment"
        width = areas.sum() / rng.uniform(6.9, 8.6) if corridor else np.sqrt(areas.sum() * rng.uniform(1.0, 1.7))
        width = float(np.round(width, 2))
        depth = float(np.round(areas.sum() / width, 2))
        if rng.random() < 0.5:
            width, depth = depth, width
        whole = (-width / 2, -depth / 2, width / 2, depth / 2)
        cells = _hall_plan(rooms, areas, whole, rng) if corridor else _slice(rooms, areas, whole, rng)
        if any(not _has_shape(kind_, cell) for kind_, cell in cells):
            continue
        doorways = _doorways(cells, rng)
        if doorways is not None:
            return _build(cells, doorways, height, whole, rng)
    raise RuntimeError(f"no floor plan found for {kind!r} in {ATTEMPTS} attempts")


def _has_shape(kind: str, cell: Rectangle) -> bool:
    shape = ROOM_KINDS[kind]
    sides = sorted((cell[2] - cell[0] - INNER_WALL_M, cell[3] - cell[1] - INNER_WALL_M))
    return sides[0] >= shape.min_side_m and sides[1] <= shape.max_aspect * sides[0]


def _slice(
    rooms: Sequence[str], areas: Float[np.ndarray, "n"], whole: Rectangle, rng: np.random.Generator
) -> list[tuple[str, Rectangle]]:
    """Cuts a rectangle in two, again and again, until every room has its piece."""
    if len(rooms) == 1:
        return [(rooms[0], whole)]
    order = rng.permutation(len(rooms))
    # Cut where both halves hold about as much.
    share = np.cumsum(areas[order]) / areas.sum()
    first = int(np.clip(1 + np.argmin(np.abs(share[:-1] - rng.uniform(0.35, 0.65))), 1, len(rooms) - 1))
    x0, y0, x1, y1 = whole
    along = 0 if (x1 - x0 > y1 - y0) == (rng.random() < 0.85) else 1
    at = float(np.round((x0, y0)[along] + share[first - 1] * (x1 - x0, y1 - y0)[along], 2))
    low = (x0, y0, at, y1) if along == 0 else (x0, y0, x1, at)
    high = (at, y0, x1, y1) if along == 0 else (x0, at, x1, y1)
    a, b = order[:first], order[first:]
    return [
        *_slice([str(rooms[i]) for i in a.tolist()], areas[a], low, rng),
        *_slice([str(rooms[i]) for i in b.tolist()], areas[b], high, rng),
    ]


def _hall_plan(
    rooms: Sequence[str], areas: Float[np.ndarray, "n"], whole: Rectangle, rng: np.random.Generator
) -> list[tuple[str, Rectangle]]:
    """A hall between two rows of rooms, which ends at a living room across the whole depth of the home."""
    x0, y0, x1, y1 = whole
    turned = y1 - y0 > x1 - x0
    if turned:
        x0, y0, x1, y1 = y0, x0, y1, x1
    hall = rooms.index("hall")
    others = [int(i) for i in rng.permutation(len(rooms)) if i != hall]
    cells: list[tuple[str, Rectangle]] = []
    living = next(i for i in others if rooms[i] == "living_room")
    others.remove(living)
    wide = float(np.round(max(areas[living] / (y1 - y0), 3.75 + 0.1 * rng.random()), 2))
    cells.append((rooms[living], (x1 - wide, y0, x1, y1)))
    x1 -= wide
    strip = float(np.round(rng.uniform(1.5, 1.75), 2)) + INNER_WALL_M
    sums = np.cumsum(areas[others])
    cut = int(np.clip(1 + np.argmin(np.abs(sums[:-1] / sums[-1] - rng.uniform(0.4, 0.6))), 1, len(others) - 1))
    rows = (others[:cut], others[cut:])
    share = areas[rows[0]].sum() / areas[others].sum()
    low = float(np.round(y0 + share * (y1 - y0 - strip), 2))
    cells.append(("hall", (x0, low, x1, low + strip)))
    for row, (bottom, top) in zip(rows, ((y0, low), (low + strip, y1)), strict=True):
        at = x0
        for index in row:
            right = x1 if index == row[-1] else float(np.round(at + (x1 - x0) * areas[index] / areas[row].sum(), 2))
            cells.append((rooms[index], (at, bottom, right, top)))
            at = right
    if turned:
        cells = [(kind, (cell[1], cell[0], cell[3], cell[2])) for kind, cell in cells]
    return cells


def _shared(a: Rectangle, b: Rectangle) -> tuple[int, float, float, float] | None:
    """The wall between two cells: the axis across it, where it is, and its ends; None if there is none."""
    for axis in (0, 1):
        for first, second in ((a, b), (b, a)):
            if abs(first[axis + 2] - second[axis]) < 1e-6:
                low = max(a[1 - axis], b[1 - axis])
                high = min(a[3 - axis], b[3 - axis])
                if high > low:
                    return axis, first[axis + 2], low, high
    return None


def _doorways(
    cells: list[tuple[str, Rectangle]], rng: np.random.Generator
) -> list[tuple[int, int, tuple[int, float, float, float], float]] | None:
    """Which rooms are joined, where, and how wide; None if some room cannot be."""
    shared = {}
    for (i, (_, a)), (j, (_, b)) in itertools.combinations(enumerate(cells), 2):
        wall = _shared(a, b)
        if wall is not None and wall[3] - wall[2] >= 0.95 + INNER_WALL_M + 2 * CORNER_M:
            shared[i, j] = wall
    public = [i for i, (kind, _) in enumerate(cells) if ROOM_KINDS[kind].public]

    def is_open(i: int, j: int) -> bool:
        """Whether a kitchen opens to a living room."""
        kinds = {cells[i][0], cells[j][0]}
        return "living_room" in kinds and bool(kinds & {"kitchen", "kitchen_diner"})

    joined: list[tuple[int, int]] = []
    # Public rooms first, until all hang together; halls join what they touch.
    reached = {public[0]}
    while len(reached) < len(public):
        edges = [(i, j) for i, j in shared if i in public and j in public and (i in reached) != (j in reached)]
        if not edges:
            return None
        joined.append(min(edges, key=lambda edge: "hall" not in (cells[edge[0]][0], cells[edge[1]][0])))
        reached |= set(joined[-1])
    joined += [pair for pair in shared if pair not in joined and is_open(*pair)]
    for index, (kind, _) in enumerate(cells):
        if index in public:
            continue
        others = [j if i == index else i for i, j in shared if index in (i, j)]
        others = [other for other in others if other in public]
        if not others:
            return None
        other = min(others, key=lambda other: _preference(kind, cells[other][0]))
        joined.append((min(index, other), max(index, other)))
    found = []
    for i, j in joined:
        wide = float(np.round(rng.uniform(0.88, 1.0), 2))
        length = shared[i, j][3] - shared[i, j][2]
        if is_open(i, j) and rng.random() < 0.6:
            wide = float(np.round(min(rng.uniform(1.3, 2.0), length - INNER_WALL_M - 2 * CORNER_M), 2))
        found.append((i, j, shared[i, j], wide))
    return found


def _preference(kind: str, neighbour: str) -> int:
    """Lower is a better neighbour to enter a room from."""
    order = ("hall", "living_room", "studio", "hotel_room", "office", "kitchen_diner", "kitchen")
    return order.index(neighbour) - (3 if kind == "meeting_room" and neighbour == "office" else 0)


def _build(cells, doorways, height: float, whole: Rectangle, rng: np.random.Generator) -> FloorPlan:
    """Turns cells and doorways into rooms with openings."""
    half = 0.5 * INNER_WALL_M
    inner = [(c[0] + half, c[1] + half, c[2] - half, c[3] - half) for _, c in cells]
    openings: list[list[Opening]] = [[] for _ in cells]
    kinds = [kind for kind, _ in cells]
    bare = [Room((r[0], r[1]), (r[2], r[3]), height, kind=kind) for r, kind in zip(inner, kinds, strict=True)]
    passages = []
    for i, j, (axis, at, low, high), wide in doorways:
        slack = (high - low) - INNER_WALL_M - 2 * CORNER_M - wide
        # Doors stand near a corner, so that walls stay long enough for furniture; wide passages anywhere.
        along = slack * (float(rng.choice([0.0, 1.0])) if wide < 1.1 else float(rng.uniform(0, 1)))
        start = float(np.round(low + half + CORNER_M + along, 3))
        rectangle = (
            (at - half, start, at + half, start + wide) if axis == 0 else (start, at - half, start + wide, at + half)
        )
        passages.append(Passage((i, j), rectangle))
        ends = np.array([[at, start], [at, start + wide]]) if axis == 0 else np.array([[start, at], [start + wide, at]])
        for index in (i, j):
            wall = min(bare[index].walls(), key=lambda w: float(np.abs((ends - w.origin) @ w.normal).sum()))
            a, b = sorted(((ends - wall.origin) @ wall.along).tolist())
            openings[index].append(Opening("passage", wall.index, a, b, 0.0, DOORWAY_HEIGHT_M))
    outer = [_outer_walls(cell, whole) for _, cell in cells]
    _entrance(cells, bare, openings, outer, rng)
    for index, (kind, _) in enumerate(cells):
        # Worktops and taps fit below kitchen windows; bathrooms have small ones high up.
        sill = {"bathroom": 1.35, "kitchen": 1.2, "kitchen_diner": 1.2}.get(kind, float(rng.choice([0.85, 0.95])))
        _windows(ROOM_KINDS[kind], bare[index], openings[index], outer[index], rng, sill)
    rooms = [replace(room, openings=tuple(found)) for room, found in zip(bare, openings, strict=True)]
    rooms = hang_leaves(rooms, [_leaf_wish(kinds, i, j) for i, j, _, _ in doorways], rng)
    edge = OUTER_WALL_M - half
    bounds = (whole[0] - edge, whole[1] - edge, whole[2] + edge, whole[3] + edge)
    return FloorPlan(tuple(rooms), tuple(passages), bounds)


def _leaf_wish(kinds: Sequence[str], i: int, j: int) -> tuple[int, int, float]:
    """The room that the leaf of a doorway opens into, the other one, and how likely there is a leaf."""
    private = [not ROOM_KINDS[kinds[index]].public for index in (i, j)]
    # Into the room that one enters, not into the one that one comes from.
    enters_i = private[0] or (not private[1] and kinds[j] == "hall")
    return (i, j, 0.95 if any(private) else 0.5) if enters_i else (j, i, 0.95 if any(private) else 0.5)


def _outer_walls(cell: Rectangle, whole: Rectangle) -> list[int]:
    """Which walls of a cell (south, east, north, west) look outside."""
    sides = ((1, 1), (2, 2), (3, 3), (0, 0))
    return [wall for wall, (a, b) in enumerate(sides) if abs(cell[a] - whole[b]) < 1e-6]


def _entrance(cells, bare: list[Room], openings, outer, rng: np.random.Generator) -> None:
    """The front door, closed: in the hall if it has an outer wall, else in another public room."""
    order = sorted(
        (i for i, (kind, _) in enumerate(cells) if ROOM_KINDS[kind].public and outer[i]),
        key=lambda i: cells[i][0] != "hall",
    )
    width = 0.92
    for index in order:
        walls = bare[index].walls()
        for wall in (int(w) for w in rng.permutation(outer[index])):
            length = walls[wall].length_m
            if length < width + 2 * CORNER_M:
                continue
            near = float(rng.uniform(CORNER_M, min(0.5, length - width - CORNER_M)))
            start = near if rng.random() < 0.5 else length - near - width
            if _free(openings[index], wall, start, start + width):
                openings[index].append(Opening("door", wall, start, start + width, 0.0, 2.03))
                return


def _windows(
    shape: RoomKind, room: Room, found: list[Opening], outer: list[int], rng: np.random.Generator, sill_m: float
) -> None:
    """Adds windows to the outer walls of a room where they leave other openings alone."""
    walls = room.walls()
    count = int(rng.integers(shape.windows[0], shape.windows[1] + 1))
    for wall in [int(w) for w in rng.permutation(outer)] if outer else []:
        if count == 0:
            return
        length = walls[wall].length_m
        for _ in range(8):
            wide = 0.6 if sill_m > 1.3 else float(rng.uniform(1.0, max(1.05, min(2.4, length - 1.0))))
            if wide > length - 0.6:
                continue
            start = float(rng.uniform(0.3, length - 0.3 - wide))
            if _free(found, wall, start, start + wide):
                found.append(Opening("window", wall, start, start + wide, sill_m, float(rng.uniform(2.1, 2.25))))
                count -= 1
                break


def _free(openings: Sequence[Opening], wall: int, start: float, end: float) -> bool:
    return all(o.wall != wall or end < o.start_m - 0.25 or start > o.end_m + 0.25 for o in openings)
