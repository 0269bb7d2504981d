"""Groups of furniture as people arrange them: a bed with its nightstands, a table with its chairs."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sbm_gym.assets.builtin import BUILTIN
from sbm_gym.assets.library import FurnitureLibrary, ModelCard
from sbm_gym.worlds.cushions import scatter_cushions
from sbm_gym.worlds.placing import Box, Layout, Placement, Wall

QUARTERS = (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi)
MAX_OBJECTS = 14
"""Objects with a class in one room, cushions aside."""


@dataclass
class Arranger:
    """Furnishes one room, group by group. A group that finds no place leaves the room as it was, or with a part."""

    layout: Layout
    library: FurnitureLibrary
    max_triangles: int = 200_000
    """Of all pieces together."""
    max_objects: int = MAX_OBJECTS

    @property
    def rng(self) -> np.random.Generator:
        """The layout's source of randomness."""
        return self.layout.rng

    def pick(
        self, use: str, accept: Callable[[ModelCard], bool] = lambda card: True, copies: int = 1
    ) -> ModelCard | None:
        """A random model for a use.

        Args:
            use: what it is for.
            accept: says which models will do.
            copies: how many of it are wanted; that many must fit into ``max_triangles``.

        Returns:
            The model, None if the library has none that will do.
        """
        cards = [card for card in self.library.models(use) if accept(card)]
        left = self.max_triangles - self.triangles()
        for index in self.rng.permutation(len(cards)):
            if self.library.load(cards[index]).num_triangles * copies <= left:
                return cards[index]
        return None

    def triangles(self) -> int:
        """Triangles of all pieces so far."""
        return sum(self.library.load(piece.card).num_triangles for piece in self.layout.placements)

    def chance(self, probability: float) -> bool:
        """True with this probability."""
        return bool(self.rng.random() < probability)

    def full(self) -> bool:
        """Whether the room has as many objects with a class as a room should."""
        return self.count() >= self.max_objects

    def along_wall(self, use: str, **how) -> Placement | None:
        """A random model for a use with its back to a wall; tries several models."""
        for _ in range(4):
            card = None if self.full() else self.pick(use)
            piece = None if card is None else self.layout.against_wall(card, **how)
            if piece is not None:
                return piece
        return None

    # Groups ---------------------------------------------------------------------------------------------------------

    def sleeping(self, use: str) -> None:
        """A bed with its head to a wall, nightstands with lamps beside it, perhaps a rug and cushions."""
        bed, stands = None, []
        for _ in range(4):
            bed = self.along_wall(use, front_m=0.5)
            if bed is None:
                return
            stands = self._nightstands(bed, 2 if use == "double_bed" and self.chance(0.85) else 1)
            if stands:
                break
            # A bed without room for a nightstand is tried elsewhere; its keep-out zone goes with it.
            self.layout.placements.remove(bed)
            self.layout.zones.pop()
        if not stands:
            bed = self.along_wall(use, front_m=0.5)
        if bed is None:
            return
        for stand in stands:
            self.decorate(stand, ("table_lamp",), 0.8)
        if self.chance(0.5):
            self.rug_before(bed)
        if self.chance(0.8):
            scatter_cushions(self.layout, self.library, bed, int(self.rng.integers(1, 4)))

    def _nightstands(self, bed: Placement, count: int) -> list[Placement]:
        """Nightstands beside the head of a bed, of one model."""
        card = self.pick("nightstand")
        if card is None or self.full():
            return []
        wall = self._wall_behind(bed)
        middle = float((np.array([bed.x_m, bed.y_m]) - wall.origin) @ wall.along)
        placed: list[Placement] = []
        for side in self.rng.permutation([-1, 1]):
            if len(placed) == count:
                break
            along = middle + side * (bed.card.size_m[0] / 2 + card.size_m[0] / 2 + 0.06)
            # One gets up on this side: floor as long as the bed, wider than the nightstand.
            x, y = wall.point(along + side * 0.2, card.size_m[1] + 0.85)
            floor = Box(float(x), float(y), card.size_m[0] / 2 + 0.22, 0.75, wall.yaw_rad)
            if not self.layout.is_clear(floor):
                continue
            stand = self.layout.against_wall(card, walls=[wall.index], centre_m=along, tries=1)
            if stand is not None:
                self.layout.zones.append(floor)
                placed.append(stand)
        return placed

    def sitting(self, *, lounge: float = 0.6, television: bool = True) -> None:
        """A couch against a wall, a low table and a rug before it, a television opposite, perhaps an armchair."""
        couch = self.along_wall("couch", front_m=1.0)
        if couch is None:
            return
        if self.chance(0.9):
            scatter_cushions(self.layout, self.library, couch, int(self.rng.integers(2, 6)))
        zones = tuple(self.layout.zones)
        low = self.pick("coffee_table")
        reach = couch.card.size_m[1] / 2
        table = None
        if low is not None and not self.full() and self.chance(0.8):
            x, y = couch.at(self.rng.uniform(-0.15, 0.15), -(reach + 0.38 + low.size_m[1] / 2))
            piece = Placement(low, float(x), float(y), couch.yaw_rad)
            if self.layout.fits(piece, ignore_zones=zones):
                table = self.layout.add(piece)
                self.decorate(table, ("table_thing", "small_plant"), 0.6)
        self.rug_before(couch)
        if television:
            self.television(couch)
        if table is not None and self.chance(lounge):
            self._armchair_at(table, couch)

    def _armchair_at(self, table: Placement, couch: Placement) -> None:
        """An armchair at one end of the low table, half turned to the couch."""
        card = self.pick("lounge_chair")
        if card is None or self.full():
            return
        for side in self.rng.permutation([-1, 1]):
            away = table.card.size_m[0] / 2 + max(card.size_m[:2]) / 2 + self.rng.uniform(0.2, 0.45)
            x, y = table.at(side * away, -0.1)
            # To its right (+x) the table lies at the left: the front must turn from -Y of the couch towards -x.
            yaw = couch.yaw_rad - side * (0.5 * np.pi) + side * self.rng.uniform(-0.5, 0.1)
            piece = Placement(card, float(x), float(y), float(yaw))
            if self.layout.fits(piece, ignore_zones=self.layout.zones[-1:]):
                self.layout.add(piece)
                return

    def television(self, watcher: Placement | None = None, supports: tuple[str, ...] = ("tv_stand",)) -> None:
        """A television on a low cabinet or on the wall, opposite ``watcher`` where that is possible."""
        if self.full():
            return
        walls, centre, spread = None, None, 0.0
        if watcher is not None:
            opposite = self.layout.room.walls()[(self._wall_behind(watcher).index + 2) % 4]
            walls = [opposite.index]
            centre = float((np.array([watcher.x_m, watcher.y_m]) - opposite.origin) @ opposite.along)
            spread = 0.5
        on_wall = self.chance(0.35)
        for attempt in range(5):
            if attempt == 2:
                walls, centre, spread, on_wall = None, None, 0.0, False
            if on_wall:
                card = self.pick("wall_tv")
                if card is not None and self.layout.against_wall(
                    card, walls=walls, centre_m=centre, spread_m=spread, elevation_m=self.rng.uniform(0.95, 1.2)
                ):
                    return
            card, screen = self.pick(str(self.rng.choice(supports))), self.pick("tv")
            stand = card and self.layout.against_wall(card, walls=walls, centre_m=centre, spread_m=spread)
            if stand is None or screen is None:
                continue
            if self.layout.on_top(screen, stand, 0.0, 0.02):
                return
            self.layout.placements.remove(stand)  # under a window, or too narrow: no place for a screen

    def dining(self, seats: tuple[int, int] = (2, 5)) -> None:
        """A table in the open or with a side to a wall, with chairs around that face it."""
        if self.full():
            return
        for _ in range(3):
            card = self.pick("dining_table")
            if card is None:
                return
            table = self.layout.in_the_open(card, around_m=0.62, yaws=QUARTERS)
            if table is not None:
                break
        else:
            return
        self.seats(table, int(self.rng.integers(seats[0], seats[1] + 1)))
        self.decorate(table, ("table_thing", "small_plant", "table_thing"), 0.8)
        card = self.pick("hanging_lamp", lambda c: self.layout.room.height_m - c.size_m[2] > 1.7)
        if card is not None and self.chance(0.6):
            z_m = self.layout.room.height_m - card.size_m[2]
            self.layout.add(Placement(card, table.x_m, table.y_m, table.yaw_rad, z_m))

    def seats(self, table: Placement, count: int, use: str = "dining_chair") -> None:
        """Chairs around a table, turned to it."""
        chair = self.pick(use, copies=count)
        if chair is None:
            return
        width, depth, _ = table.card.size_m
        places = []
        for half, length, turn in ((depth / 2, width, 0.0), (width / 2, depth, 0.5 * np.pi)):
            number = min(max(int(length / (chair.size_m[0] + 0.12)), 1), 3)
            if turn and depth < 0.6:
                continue
            for side in (0.0, np.pi):
                for offset in (np.arange(number) - (number - 1) / 2) * (length / number):
                    places.append((turn + side, half, offset))
        seated = 0
        for index in self.rng.permutation(len(places)):
            if self.full() or seated == count:
                return
            turn, half, offset = places[index]
            # In the table's axes turned by ``turn``, the chair stands behind (+Y) and looks along -Y, at the table.
            away = half + chair.size_m[1] / 2 + self.rng.uniform(0.03, 0.10)
            local = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ [offset, away]
            x, y = table.at(*local)
            yaw = table.yaw_rad + turn + self.rng.normal(0, 0.08)
            piece = Placement(chair, float(x), float(y), float(yaw))
            if self.layout.fits(piece, margin_m=0.02):
                self.layout.add(piece)
                seated += 1

    def working(self) -> None:
        """A desk against a wall with a chair before it, a lamp and things on it."""
        desk = self.along_wall("desk", front_m=0.9)
        if desk is None:
            return
        card = self.pick("office_chair" if self.chance(0.75) else "dining_chair")
        if card is not None and not self.full():
            # The catalogue's desks show their front (drawers, modesty panel aside) to whoever sits there.
            x, y = desk.at(self.rng.uniform(-0.12, 0.12), -(desk.card.size_m[1] + card.size_m[1]) / 2 - 0.05)
            piece = Placement(card, float(x), float(y), desk.yaw_rad + np.pi + self.rng.normal(0, 0.3))
            if self.layout.fits(piece, margin_m=0.01, ignore_zones=self.layout.zones):
                self.layout.add(piece)
        self.decorate(desk, ("desk_thing", "desk_lamp", "desk_thing"), 0.75)

    def kitchen(self, units: int = 3) -> None:
        """A fridge in a corner and rows of kitchen units along its wall and others."""
        card = self.pick("fridge")
        fridge = card and self.layout.against_wall(card, corner=True, front_m=0.7)
        if not fridge:
            fridge = self.along_wall("fridge", front_m=0.7)
        if fridge is None or units == 0:
            return
        family = self.pick("kitchen_unit")
        if family is None:
            return
        wall = self._wall_behind(fridge)
        middle = float((np.array([fridge.x_m, fridge.y_m]) - wall.origin) @ wall.along)
        side = 1 if middle < wall.length_m / 2 else -1
        placed = self._unit_row(wall, middle + side * (fridge.card.size_m[0] / 2 + 0.02), side, units, family)
        for index in self.rng.permutation(4):
            if placed >= max(units - 1, 1):
                return
            other = self.layout.room.walls()[index]
            way = int(self.rng.choice([-1, 1]))
            start = 0.0 if way == 1 else other.length_m
            placed += self._unit_row(other, start, way, units - placed, family)

    def _unit_row(self, wall: Wall, edge_m: float, side: int, units: int, family: ModelCard) -> int:
        """Kitchen units side by side along a wall, from a place on; returns how many."""
        for number in range(units):
            # Builtin units are all of different colours; a catalogue's go together.
            alike = family.library == BUILTIN
            unit = family if alike else self.pick("kitchen_unit", lambda card: card.library == family.library)
            if unit is None:
                return number
            centre = edge_m + side * (unit.size_m[0] / 2 + 0.032)
            if self.layout.against_wall(unit, walls=[wall.index], centre_m=centre, front_m=0.6, tries=1) is None:
                return number
            edge_m = centre + side * unit.size_m[0] / 2
        return units

    def bathing(self, tub: bool = False) -> None:
        """A toilet against a wall, a washbasin near it, and a bathtub if there is room."""
        bath = self.along_wall("bathtub", corner=True, front_m=0.4) if tub else None
        toilet = self.along_wall("toilet", front_m=0.6)
        if toilet is None and bath is not None:
            self.layout.placements.remove(bath)
            toilet = self.along_wall("toilet", front_m=0.6)
        if toilet is None:
            return
        wall = self._wall_behind(toilet)
        middle = float((np.array([toilet.x_m, toilet.y_m]) - wall.origin) @ wall.along)
        for _ in range(3):
            basin = self.pick("washbasin")
            if basin is None:
                return
            for side in self.rng.permutation([-1, 1]):
                offset = side * (toilet.card.size_m[0] / 2 + basin.size_m[0] / 2 + 0.25)
                if self.layout.against_wall(
                    basin, walls=[wall.index], centre_m=middle + offset, spread_m=0.1, front_m=0.5, tries=4
                ):
                    return
            if self.layout.against_wall(basin, front_m=0.5, tries=15):
                return

    def storing(self, use: str, top: tuple[str, ...] = ()) -> None:
        """A shelf, cupboard or dresser against a wall; perhaps things on it."""
        piece = self.along_wall(use, front_m=0.45)
        if piece is not None and top:
            self.decorate(piece, top, 0.7)

    def greening(self) -> None:
        """A plant in a corner, else somewhere along a wall."""
        if self.full():
            return
        card = self.pick("floor_plant")
        if card is not None and self.layout.against_wall(card, corner=True, tries=8) is None:
            self.layout.against_wall(card, tries=20)

    def lounging(self, use: str = "lounge_chair") -> None:
        """An armchair or beanbag near a wall, turned into the room."""
        card = None if self.full() else self.pick(use)
        if card is None:
            return
        low, high = np.array(self.layout.room.low_m), np.array(self.layout.room.high_m)
        for _ in range(60):
            x, y = self.rng.uniform(low + 0.5, high - 0.5)
            centre = 0.5 * (low + high) - [x, y]
            yaw = np.arctan2(centre[0], -centre[1]) + self.rng.normal(0, 0.35)
            piece = Placement(card, float(x), float(y), float(yaw))
            zone = piece.front_zone(0.6)
            edge = min(x - low[0], high[0] - x, y - low[1], high[1] - y)
            if edge < 1.1 and self.layout.fits(piece, margin_m=0.1) and self.layout.is_clear(zone):
                self.layout.add(piece, zone)
                return

    def lamp(self) -> None:
        """A standard lamp along a wall."""
        card = self.pick("floor_lamp")
        if card is not None:
            self.layout.against_wall(card, corner=self.chance(0.5), tries=15)

    def small(self, use: str) -> None:
        """A bin, radiator or office cabinet along a wall."""
        card = self.pick(use)
        if card is not None:
            self.layout.against_wall(card, tries=15)

    def radiator(self) -> None:
        """A radiator under a window."""
        for opening in self.layout.room.openings:
            card = self.pick("radiator", lambda c: c.size_m[2] < 0.75)
            if opening.kind == "window" and card is not None:
                self.layout.against_wall(
                    card, walls=[opening.wall], centre_m=0.5 * (opening.start_m + opening.end_m), spread_m=0.2, tries=3
                )

    def count(self) -> int:
        """Objects with a class so far, cushions aside."""
        return sum(piece.card.category not in (None, "cushion") for piece in self.layout.placements)

    def fill(self, target: int, extras: tuple[str, ...]) -> None:
        """Adds single pieces until there are ``target`` objects, as far as there is room.

        Args:
            target: objects with a class, cushions aside.
            extras: what may be added, keys of the table below.
        """
        ways: dict[str, Callable[[], None]] = {
            "plant": self.greening,
            "armchair": self.lounging,
            "beanbag": lambda: self.lounging("beanbag"),
            "shelf": lambda: self.storing("shelf"),
            "chair": lambda: self.lounging("dining_chair"),
            "desk": self.working,
            "dresser": lambda: self.storing("dresser", ("small_plant",)),
        }
        for _ in range(10):
            if not extras or self.count() >= target:
                return
            ways[extras[self.rng.integers(len(extras))]]()

    def decorate(self, support: Placement, uses: tuple[str, ...], probability: float) -> None:
        """Small things on top of a piece, each with a probability."""
        half = np.array(support.card.size_m[:2]) / 2
        for use in uses:
            card = self.pick(use) if self.chance(probability) else None
            if card is None or (card.category is not None and self.full()):
                continue
            for _ in range(6):
                right, back = self.rng.uniform(-0.8, 0.8, 2) * half
                yaw = np.pi + self.rng.normal(0, 0.3) if use == "desk_thing" else self.rng.uniform(-np.pi, np.pi)
                if use == "desk_thing":
                    back, yaw = 0.1 * half[1], self.rng.normal(0, 0.25)
                if self.layout.on_top(card, support, float(right), float(back), float(yaw)):
                    break

    def rug_before(self, piece: Placement) -> None:
        """Notes where a rug lies; rugs have no height to collide with."""
        card = self.pick("rug") if self.chance(0.75) else None
        if card is None:
            return
        x, y = piece.at(0.0, -piece.card.size_m[1] / 2 - 0.25)
        turned = bool(self.rng.random() < 0.8)
        rug = Placement(card, float(x), float(y), piece.yaw_rad + (0.5 * np.pi if turned else 0.0))
        corners = rug.box().corners()
        low, high = np.array(self.layout.room.low_m) + 0.1, np.array(self.layout.room.high_m) - 0.1
        shift = np.maximum(low - corners.min(axis=0), 0) - np.maximum(corners.max(axis=0) - high, 0)
        moved = Placement(card, float(x + shift[0]), float(y + shift[1]), rug.yaw_rad)
        corners = moved.box().corners()
        if np.all(corners >= low - 1e-6) and np.all(corners <= high + 1e-6) and not self.rugs:
            self.rugs.append(moved)

    def __post_init__(self) -> None:
        self.rugs: list[Placement] = []

    def _wall_behind(self, piece: Placement):
        return min(self.layout.room.walls(), key=lambda wall: abs(np.sin((wall.yaw_rad - piece.yaw_rad) / 2)))
