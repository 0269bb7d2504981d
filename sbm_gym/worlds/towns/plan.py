"""The plan of a town: a ring of streets with others across, blocks between them, and where vehicles naturally stand.

Traffic keeps to the right. The outermost streets form a ring; beyond it stands one more row of houses, so that every
street ends at a facade and never at the end of the world.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.geometry.placing import Box

LANE_M = 3.2
PARKING_M = 2.3
"""Width of a parking strip."""
GUTTER_M = 0.35
"""Between the lane and the kerb where nobody parks."""
PAVEMENT_M = 3.4
KERB_M = 0.12
"""Height of pavements above the road."""
CORNER_M = 2.5
"""Radius of kerbs at corners."""
HOUSE_DEPTH_M = 10.0
CROSSING_M = (1.2, 4.2)
"""Zebra crossings begin and end this far before a junction."""
STOP_LINE_M = 5.0
FIRST_BAY_M = 8.0
"""Nobody parks nearer to a junction."""
BAY_M, LOADING_BAY_M, BUS_BAY_M = 6.2, 9.0, 15.5
RACK_M = 2.35
"""From the kerb to where bicycles stand."""
CAR_PARK_M = KERB_M + 0.01
"""Height of the asphalt of car parks."""


@dataclass(frozen=True)
class Rect:
    """An axis-aligned rectangle."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def size_m(self) -> tuple[float, float]:
        """Lengths along x and y."""
        return self.x1 - self.x0, self.y1 - self.y0

    @property
    def middle_m(self) -> tuple[float, float]:
        """Its middle."""
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1)

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Its corners, counter-clockwise from the least."""
        return [(self.x0, self.y0), (self.x1, self.y0), (self.x1, self.y1), (self.x0, self.y1)]

    @property
    def box(self) -> Box:
        """What stands on it, of any height."""
        return Box(*self.middle_m, self.size_m[0] / 2, self.size_m[1] / 2, 0.0)

    def shrunk(self, by_m: float) -> "Rect":
        """The rectangle without a rim."""
        return Rect(self.x0 + by_m, self.y0 + by_m, self.x1 - by_m, self.y1 - by_m)


@dataclass(frozen=True)
class Spawn:
    """A place where a vehicle naturally stands: a parking bay, a queue at a junction, a rack."""

    x_m: float
    y_m: float
    heading_rad: float
    """Where the vehicle's front points, counter-clockwise from +X."""
    length_m: float
    width_m: float
    kind: str
    """``bay``, ``loading``, ``bus``, ``lane`` or ``rack``."""
    z_m: float = 0.0

    @property
    def yaw_rad(self) -> float:
        """Yaw of a model whose front looks along -Y at yaw 0."""
        return self.heading_rad + 0.5 * np.pi

    @property
    def middle_m(self) -> Float[np.ndarray, "2"]:
        """Its middle."""
        return np.array([self.x_m, self.y_m])

    @property
    def ahead(self) -> Float[np.ndarray, "2"]:
        """Where the vehicle's front points, as a unit vector."""
        return np.array([np.cos(self.heading_rad), np.sin(self.heading_rad)])

    def area(self) -> Box:
        """The floor that the place covers."""
        return Box(self.x_m, self.y_m, self.length_m / 2, self.width_m / 2, self.heading_rad)


@dataclass(frozen=True)
class Street:
    """A straight street between two ends of the ring."""

    axis: int
    """0: runs along x, 1: along y."""
    centre_m: float
    """Its middle line's coordinate across."""
    half_m: tuple[float, float]
    """From the middle line to the kerbs, on the side of greater and smaller coordinate across."""
    parking: tuple[bool, bool]
    """Whether people park there, sides in the same order."""

    @property
    def low_m(self) -> float:
        """Coordinate across of its kerb on the lesser side."""
        return self.centre_m - self.half_m[1]

    @property
    def high_m(self) -> float:
        """Coordinate across of its kerb on the greater side."""
        return self.centre_m + self.half_m[0]

    def point(self, along_m, across_m) -> Float[np.ndarray, "*shape 2"]:
        """World points of coordinates along and across (from the middle line)."""
        along, across = np.broadcast_arrays(np.asarray(along_m, float), np.asarray(across_m, float) + self.centre_m)
        return np.stack([along, across] if self.axis == 0 else [across, along], axis=-1)

    def heading_rad(self, forward: bool) -> float:
        """Heading of traffic towards greater (or smaller) coordinates."""
        return (0.0 if forward else np.pi) + (0.5 * np.pi if self.axis else 0.0)

    def right_side(self, forward: bool) -> int:
        """Sign of the across coordinate on the right-hand side of that traffic."""
        # Heading along +x the right is -y; heading along +y it is +x.
        return (-1 if forward else 1) * (1 if self.axis == 0 else -1)


@dataclass(frozen=True)
class Segment:
    """A street between two neighbouring junctions."""

    street: Street
    start_m: float
    end_m: float
    """Where the kerbs of the crossing streets end and begin, coordinates along."""
    stops: tuple[bool, bool]
    """Whether traffic waits at its start (coming from its end) and at its end."""


@dataclass(frozen=True)
class Block:
    """Land between streets."""

    rect: Rect
    """Up to the kerbs."""
    kind: str
    """``houses``, ``park``, ``square`` or ``car_park``."""


@dataclass(frozen=True)
class TownPlan:
    """All that is fixed about a town before it is built."""

    carriageway: Rect
    """Everything between the outer kerbs of the ring."""
    blocks: tuple[Block, ...]
    segments: tuple[Segment, ...]
    spawns: tuple[Spawn, ...]

    @property
    def walkable(self) -> Rect:
        """The land between the outermost houses."""
        return self.carriageway.shrunk(-PAVEMENT_M)

    @property
    def whole(self) -> Rect:
        """The land with the outermost houses."""
        return self.walkable.shrunk(-HOUSE_DEPTH_M)


def draw_plan(rng: np.random.Generator) -> TownPlan:
    """Draws a town of two by two, three by one or three by two blocks."""
    across, down = ((2, 2), (3, 1), (2, 2), (3, 2))[int(rng.integers(4))]
    xs = _lines(rng, across)
    ys = _lines(rng, down)
    vertical = [_street(rng, 1, float(x), outer=(i == 0, i == across)) for i, x in enumerate(xs)]
    horizontal = [_street(rng, 0, float(y), outer=(i == 0, i == down)) for i, y in enumerate(ys)]
    carriageway = Rect(vertical[0].low_m, horizontal[0].low_m, vertical[-1].high_m, horizontal[-1].high_m)
    kinds = _block_kinds(rng, across * down)
    blocks = []
    for (left, right), (low, high) in itertools.product(itertools.pairwise(vertical), itertools.pairwise(horizontal)):
        blocks.append(Block(Rect(left.high_m, low.high_m, right.low_m, high.low_m), kinds[len(blocks)]))
    segments = []
    for streets, others in ((vertical, horizontal), (horizontal, vertical)):
        for i, street in enumerate(streets):
            on_ring = i in (0, len(streets) - 1)
            for j, (first, second) in enumerate(itertools.pairwise(others)):
                # Where two streets of the ring meet the road just bends, and nobody waits.
                stops = (not (on_ring and j == 0), not (on_ring and j == len(others) - 2))
                segments.append(Segment(street, first.high_m, second.low_m, stops))
    spawns = [spawn for segment in segments for spawn in _spawns(rng, segment)]
    for block in blocks:
        if block.kind == "car_park":
            spawns += car_park_bays(block)
        if block.kind != "houses":
            spawns += _racks(rng, block)
    return TownPlan(carriageway, tuple(blocks), tuple(segments), tuple(spawns))


def _lines(rng: np.random.Generator, count: int) -> Float[np.ndarray, "n"]:
    gaps = rng.uniform(36.0, 46.0, count)
    lines = np.concatenate([[0.0], np.cumsum(gaps)])
    return np.round(lines - lines[-1] / 2, 1)


def _street(rng: np.random.Generator, axis: int, centre_m: float, outer: tuple[bool, bool]) -> Street:
    """A street; those of the ring have parking on their inner side at least."""
    high, low = bool(rng.random() < 0.6), bool(rng.random() < 0.6)
    high, low = high or outer[0], low or outer[1]
    half = tuple(LANE_M + (PARKING_M if parks else GUTTER_M) for parks in (high, low))
    return Street(axis, centre_m, (half[0], half[1]), (high, low))


def _block_kinds(rng: np.random.Generator, count: int) -> list[str]:
    special = ["park", "car_park", "square"]
    rng.shuffle(special)
    kinds = [*special[: 1 if count < 4 else 2], *["houses"] * count][:count]
    rng.shuffle(kinds)
    return kinds


def _spawns(rng: np.random.Generator, segment: Segment) -> list[Spawn]:
    """Parking bays along both kerbs, and places in the lanes before the junctions."""
    street, spawns = segment.street, []
    for forward in (True, False):
        side = street.right_side(forward)
        index = 0 if side > 0 else 1
        heading = street.heading_rad(forward)
        if street.parking[index]:
            middle = side * (LANE_M + PARKING_M / 2)
            at = segment.start_m + FIRST_BAY_M
            while True:
                drawn = rng.random()
                kind, length = ("bay", BAY_M) if drawn < 0.82 else ("loading", LOADING_BAY_M)
                if drawn > 0.94:
                    kind, length = "bus", BUS_BAY_M
                if at + length > segment.end_m - FIRST_BAY_M:
                    break
                x, y = street.point(at + length / 2, middle).tolist()
                spawns.append(Spawn(x, y, heading, length, PARKING_M, kind))
                at += length
        if segment.stops[1 if forward else 0]:
            front = segment.end_m - STOP_LINE_M - 0.6 if forward else segment.start_m + STOP_LINE_M + 0.6
            back = -1.0 if forward else 1.0
            for length in (13.0,) if rng.random() < 0.25 else (6.4, 6.4):
                x, y = street.point(front + back * length / 2, side * LANE_M / 2).tolist()
                spawns.append(Spawn(x, y, heading, length, LANE_M, "lane"))
                front += back * length
    return spawns


def _racks(rng: np.random.Generator, block: Block) -> list[Spawn]:
    """Places for bicycles on the pavement, where no wall stands behind them: a ring around them is free."""
    r = block.rect
    sides = (
        (r.x0, r.y0 + RACK_M, r.x1, r.y0 + RACK_M, 0.0),
        (r.x0, r.y1 - RACK_M, r.x1, r.y1 - RACK_M, np.pi),
        (r.x0 + RACK_M, r.y0, r.x0 + RACK_M, r.y1, -0.5 * np.pi),
        (r.x1 - RACK_M, r.y0, r.x1 - RACK_M, r.y1, 0.5 * np.pi),
    )
    spawns = []
    # Hedges line the other sides of parks and car parks.
    for x0, y0, x1, y1, heading in sides if block.kind == "square" else sides[2:]:
        if rng.random() < 0.7:
            share = rng.uniform(0.12, 0.28)
            side = np.array([x1 - x0, y1 - y0])
            step = side / np.hypot(*side) * 2.2
            for k in range(int(rng.integers(1, 4))):
                x, y = (np.array([x0, y0]) + share * side + k * step).tolist()
                turn = heading + np.pi * float(rng.integers(2))
                spawns.append(Spawn(x, y, turn, 2.0, 0.9, "rack", KERB_M))
    return spawns


def car_park_bays(block: Block) -> list[Spawn]:
    """Two rows of bays, nose to the middle of a car park."""
    inner, length, width = block.rect.shrunk(PAVEMENT_M), 5.2, 2.7
    x, y = inner.middle_m
    count = int((inner.size_m[0] - 4.0) / width)
    first = x - 0.5 * (count - 1) * width
    return [
        Spawn(first + k * width, y + s * (3.2 + length / 2), s * 0.5 * np.pi, length, width, "bay", CAR_PARK_M)
        for s in (-1, 1)
        for k in range(count)
    ]
