"""Putting pieces into a room without collisions: oriented footprints with heights, walls, keep-out zones.

Thousands of places are tried for one scene: what is asked for each of them is plain arithmetic on a few numbers.
"""

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from sbm_gym.assets.catalog.library import ModelCard

WALL_GAP_M = 0.03
"""Between the back of a piece and its wall: room for the skirting."""
LEAF_GAP_M = 0.06
"""Between a piece and a door leaf: room for the handle."""


@dataclass(frozen=True)
class Box:
    """An upright box: a rectangle on the floor plan that may be turned, and a range of heights."""

    x_m: float
    y_m: float
    half_x_m: float
    half_y_m: float
    yaw_rad: float
    low_m: float = 0.0
    high_m: float = 10.0

    def corners(self) -> Float[np.ndarray, "4 2"]:
        """The corners of the rectangle, counter-clockwise."""
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float) * [self.half_x_m, self.half_y_m]
        return signs @ rotation(self.yaw_rad).T + [self.x_m, self.y_m]

    def reach_m(self, yaw_rad: float = 0.0) -> tuple[float, float]:
        """How far the rectangle reaches from its middle along axes turned by ``yaw_rad``."""
        cos, sin = abs(math.cos(self.yaw_rad - yaw_rad)), abs(math.sin(self.yaw_rad - yaw_rad))
        return self.half_x_m * cos + self.half_y_m * sin, self.half_x_m * sin + self.half_y_m * cos

    def bounds(self) -> tuple[float, float, float, float]:
        """The least x and y of the rectangle, and the greatest."""
        x, y = self.reach_m()
        return self.x_m - x, self.y_m - y, self.x_m + x, self.y_m + y


def rotation(yaw_rad: float) -> Float[np.ndarray, "2 2"]:
    """Turns floor vectors counter-clockwise by ``yaw_rad``."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[cos, -sin], [sin, cos]])


def yaw_quaternion(yaw_rad: float) -> list[float]:
    """A turn about the upright axis, wxyz."""
    return [float(np.cos(yaw_rad / 2)), 0.0, 0.0, float(np.sin(yaw_rad / 2))]


def obstacle_rows(boxes: Iterable[Box]) -> Float[np.ndarray, "n 5"]:
    """Boxes as obstacles of ``navigable_map``."""
    return np.array([(b.x_m, b.y_m, b.half_x_m, b.half_y_m, b.yaw_rad) for b in boxes], float).reshape(-1, 5)


def overlap(a: Box, b: Box, margin_m: float = 0.0) -> bool:
    """Whether two boxes come closer than ``margin_m`` on the plan and share heights (touching tops do not count).

    Source: separating axis theorem.
    """
    if a.low_m >= b.high_m - 1e-6 or b.low_m >= a.high_m - 1e-6:
        return False
    x, y = b.x_m - a.x_m, b.y_m - a.y_m
    reach = math.hypot(a.half_x_m, a.half_y_m) + math.hypot(b.half_x_m, b.half_y_m) + margin_m
    if x * x + y * y > reach * reach:
        return False  # their circles do not meet: the cheap answer to most questions
    for one, other in ((a, b), (b, a)):
        cos, sin = math.cos(one.yaw_rad), math.sin(one.yaw_rad)
        along, across = other.reach_m(one.yaw_rad)
        if abs(x * cos + y * sin) - one.half_x_m - along >= margin_m - 1e-9:
            return False
        if abs(y * cos - x * sin) - one.half_y_m - across >= margin_m - 1e-9:
            return False
    return True


@dataclass(frozen=True)
class Placement:
    """A piece of furniture or a vehicle where it stands; at yaw 0 its front looks towards -Y."""

    card: ModelCard
    x_m: float
    y_m: float
    yaw_rad: float
    z_m: float = 0.0
    on: "Placement | None" = None
    """What it stands or lies on, the floor if None."""

    @functools.cached_property
    def box(self) -> Box:
        """The room the piece takes up."""
        width, depth, height = self.card.size_m
        return Box(self.x_m, self.y_m, width / 2, depth / 2, self.yaw_rad, self.z_m, self.z_m + height)

    def at(self, right_m: float, back_m: float) -> tuple[float, float]:
        """Floor position of a point given along the piece's own axes, from its middle."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (
            float(self.x_m + cos * right_m - sin * back_m),
            float(self.y_m + sin * right_m + cos * back_m),
        )

    def footprint(self, rectangles_m: Float[np.ndarray, "boxes 4"]) -> list[Box]:
        """The floor it covers, given the rectangles (min x, min y, max x, max y) that its model covers."""
        return [
            Box(*self.at((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0) / 2, (y1 - y0) / 2, self.yaw_rad)
            for x0, y0, x1, y1 in rectangles_m
        ]

    def front_zone(self, depth_m: float) -> Box:
        """The floor before the piece, as wide as the piece."""
        width, depth, _ = self.card.size_m
        return Box(*self.at(0.0, -depth / 2 - depth_m / 2), width / 2, depth_m / 2, self.yaw_rad)


@dataclass(frozen=True)
class Opening:
    """A door or window in a wall."""

    kind: str
    """``door`` (closed), ``window`` or ``passage`` (open, to another room)."""
    wall: int
    start_m: float
    """Where it begins, along the wall."""
    end_m: float
    low_m: float
    high_m: float


@dataclass(frozen=True)
class Wall:
    """One side of a room, seen from inside: it runs along ``along`` and looks along ``normal``."""

    index: int
    origin: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    normal: Float[np.ndarray, "2"]
    length_m: float

    @functools.cached_property
    def yaw_rad(self) -> float:
        """Yaw of a piece with its back to this wall."""
        # The front of a piece at yaw a looks along (sin a, -cos a).
        return float(np.arctan2(self.normal[0], -self.normal[1]))

    def point(self, along_m: float, out_m: float) -> tuple[float, float]:
        """A floor point given along the wall and out from it."""
        x, y, along_x, along_y, normal_x, normal_y = self._numbers
        return float(x + along_m * along_x + out_m * normal_x), float(y + along_m * along_y + out_m * normal_y)

    def shadow(self, box: Box) -> tuple[float, float, float]:
        """Where a box begins and ends along the wall, and how far it keeps from it."""
        x0, y0, along_x, along_y, normal_x, normal_y = self._numbers
        x, y = box.x_m - x0, box.y_m - y0
        along = x * along_x + y * along_y
        out = x * normal_x + y * normal_y
        half, deep = box.reach_m(math.atan2(along_y, along_x))
        return along - half, along + half, out - deep

    @functools.cached_property
    def _numbers(self) -> tuple[float, float, float, float, float, float]:
        """Origin, direction along and normal as plain numbers, for places are tried by the thousand."""
        x, y, along_x, along_y, normal_x, normal_y = np.concatenate([self.origin, self.along, self.normal]).tolist()
        return x, y, along_x, along_y, normal_x, normal_y


@dataclass(frozen=True)
class Room:
    """A rectangular room with its openings. Walls are numbered south, east, north, west."""

    low_m: tuple[float, float]
    high_m: tuple[float, float]
    height_m: float
    openings: tuple[Opening, ...] = ()
    leaves: tuple[Box, ...] = ()
    """Door leaves that stand open in it."""
    kind: str = ""
    """What it is for, a key of ``ROOM_KINDS``; empty if that does not matter."""

    @property
    def size_m(self) -> tuple[float, float]:
        """Lengths along x and y."""
        return self.high_m[0] - self.low_m[0], self.high_m[1] - self.low_m[1]

    def walls(self) -> tuple[Wall, Wall, Wall, Wall]:
        """The four sides; each runs so that the room is on its left."""
        return _walls(self.low_m, self.high_m)


@functools.lru_cache(maxsize=256)
def _walls(low_m: tuple[float, float], high_m: tuple[float, float]) -> tuple[Wall, Wall, Wall, Wall]:
    (x0, y0), (x1, y1) = low_m, high_m
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    walls = []
    for index, (start, end) in enumerate(zip(corners, corners[1:] + corners[:1], strict=True)):
        run = np.array(end) - np.array(start)
        length = float(np.linalg.norm(run))
        along = run / length
        walls.append(Wall(index, np.array(start, float), along, np.array([-along[1], along[0]]), length))
    return walls[0], walls[1], walls[2], walls[3]


@dataclass
class Layout:
    """A room being furnished: what stands where, and which floor stays empty."""

    room: Room
    rng: np.random.Generator
    placements: list[Placement] = field(default_factory=list)
    zones: list[Box] = field(default_factory=list)
    """Floor that nothing solid may stand on: before doors, fridges, toilets."""
    rugs: list[Placement] = field(default_factory=list)
    """Rugs have no height to collide with; they lie under what stands on them."""

    def __post_init__(self) -> None:
        walls = self.room.walls()
        for opening in self.room.openings:
            if opening.kind != "window":
                wall = walls[opening.wall]
                before = wall.point(0.5 * (opening.start_m + opening.end_m), 0.55)
                half = 0.5 * (opening.end_m - opening.start_m) + 0.1
                self.zones.append(Box(*before, half, 0.55, wall.yaw_rad))

    def fits(self, piece: Placement, margin_m: float = 0.03, ignore_zones: Iterable[Box] = ()) -> bool:
        """Whether a piece is inside the room and clear of every other piece, opening and zone."""
        box = piece.box
        if not self._is_inside(box, 0.005) or box.high_m > self.room.height_m + 1e-6 or self._hides_opening(box):
            return False
        if any(overlap(box, leaf, max(margin_m, LEAF_GAP_M)) for leaf in self.room.leaves):
            return False
        if any(overlap(box, other.box, margin_m) for other in self.placements):
            return False
        spared = list(ignore_zones)
        return not any(overlap(box, zone) for zone in self.zones if zone not in spared)

    def add(self, piece: Placement, *zones: Box) -> Placement:
        """Puts a piece into the room and keeps zones free from now on."""
        self.placements.append(piece)
        self.zones.extend(zones)
        return piece

    def mark(self) -> tuple[int, int]:
        """Where the room stands now, for ``undo``."""
        return len(self.placements), len(self.zones)

    def undo(self, mark: tuple[int, int]) -> None:
        """Takes out what was put in since ``mark``."""
        del self.placements[mark[0] :], self.zones[mark[1] :]

    def against_wall(
        self,
        card: ModelCard,
        *,
        walls: Iterable[int] | None = None,
        centre_m: float | None = None,
        spread_m: float = 0.0,
        corner: bool = False,
        front_m: float = 0.0,
        elevation_m: float = 0.0,
        tries: int = 40,
        margin_m: float = 0.03,
        gap_m: float = WALL_GAP_M,
        ignore_zones: Iterable[Box] = (),
    ) -> Placement | None:
        """Stands a piece with its back to a wall.

        Args:
            card: the piece.
            walls: which walls to try; all of them if None.
            centre_m: where along the wall its middle should be; anywhere if None.
            spread_m: how far from there it may be.
            corner: push it into a corner.
            front_m: free floor it needs before it, which is kept free from then on.
            elevation_m: height of its underside.
            tries: how many places to try.
            margin_m: how near other pieces may be.
            gap_m: between its back and the wall.
            ignore_zones: zones it may stand in.

        Returns:
            The piece where it now stands, or None if there was no place.
        """
        sides = self.room.walls()
        choices = list(range(4)) if walls is None else list(walls)
        width, depth, _ = card.size_m
        for _ in range(tries):
            wall = sides[choices[self.rng.integers(len(choices))]]
            slack = wall.length_m - width - 2 * WALL_GAP_M
            if slack < 0:
                continue
            if centre_m is not None:
                along = centre_m + self.rng.uniform(-spread_m, spread_m)
            elif corner:
                along = width / 2 + WALL_GAP_M + (slack if self.rng.random() < 0.5 else 0.0)
            else:
                along = width / 2 + WALL_GAP_M + self.rng.uniform(0, slack)
            piece = Placement(card, *wall.point(along, depth / 2 + gap_m), wall.yaw_rad, elevation_m)
            if not self.fits(piece, margin_m, ignore_zones):
                continue
            zone = piece.front_zone(front_m)
            if front_m == 0 or self.is_clear(zone):
                return self.add(piece, zone) if front_m else self.add(piece)
        return None

    def in_the_open(
        self, card: ModelCard, *, around_m: float, yaws: tuple[float, ...] | None = None, tries: int = 60
    ) -> Placement | None:
        """Stands a piece away from the walls, with ``around_m`` of free floor on all sides of it.

        Args:
            card: the piece.
            around_m: free floor around it; it is not kept free afterwards.
            yaws: which ways it may be turned; any way if None.
            tries: how many places to try.
        """
        (x0, y0), (x1, y1) = self.room.low_m, self.room.high_m
        for _ in range(tries):
            yaw = self.rng.uniform(-np.pi, np.pi) if yaws is None else yaws[self.rng.integers(len(yaws))]
            piece = Placement(card, self.rng.uniform(x0, x1), self.rng.uniform(y0, y1), float(yaw))
            half_x, half_y = card.size_m[0] / 2 + around_m, card.size_m[1] / 2 + around_m
            apron = Box(piece.x_m, piece.y_m, half_x, half_y, piece.yaw_rad, 0.0, 2.0)
            if self.fits(piece) and self.is_clear(apron):
                return self.add(piece)
        return None

    def on_top(self, card: ModelCard, support: Placement, right_m: float, back_m: float, yaw_rad: float = 0.0):
        """Puts a small thing on a piece.

        Args:
            card: the thing.
            support: what it stands on.
            right_m: where, along the support's own axes, from its middle.
            back_m: likewise.
            yaw_rad: its turn relative to the support.

        Returns:
            The thing where it stands, or None if it does not fit there.
        """
        top = support.card.top_m
        if top is None or abs(top - support.card.size_m[2]) > 0.03:
            return None
        reach = np.abs(rotation(yaw_rad)) @ np.array(card.size_m[:2]) / 2
        if np.any(np.abs([right_m, back_m]) + reach > np.array(support.card.size_m[:2]) / 2 + 0.01):
            return None
        z = support.z_m + support.card.size_m[2]
        thing = Placement(card, *support.at(right_m, back_m), support.yaw_rad + yaw_rad, z, support)
        return self.add(thing) if self.fits(thing, margin_m=0.01, ignore_zones=self.zones) else None

    def is_clear(self, zone: Box) -> bool:
        """Whether a stretch of floor is inside the room and nothing stands on it."""
        solid = (*self.room.leaves, *(piece.box for piece in self.placements))
        return self._is_inside(zone) and not any(overlap(zone, box) for box in solid)

    def _is_inside(self, box: Box, gap_m: float = 0.0) -> bool:
        """Whether a box keeps ``gap_m`` from all walls."""
        x0, y0, x1, y1 = box.bounds()
        low, high = self.room.low_m, self.room.high_m
        return min(x0 - low[0], y0 - low[1], high[0] - x1, high[1] - y1) >= gap_m

    def _hides_opening(self, box: Box) -> bool:
        """Whether a box stands close before a door or window and reaches into its height."""
        walls = self.room.walls()
        for opening in self.room.openings:
            if box.high_m <= opening.low_m + 0.02 or box.low_m >= opening.high_m:
                continue
            low, high, out = walls[opening.wall].shadow(box)
            # Beside windows hang curtains.
            beside = 0.3 if opening.kind == "window" else 0.06
            if out < 0.3 and high > opening.start_m - beside and low < opening.end_m + beside:
                return True
        return False
