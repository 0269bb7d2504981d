"""Fitted kitchens: a fridge in a corner, base cabinets side by side along the walls, wall cabinets and a hood above."""

from collections.abc import Callable

import numpy as np

from sbm_gym.assets.catalog.library import ModelCard
from sbm_gym.assets.parametric.builtin import family
from sbm_gym.worlds.geometry.placing import WALL_GAP_M, Box, Placement, Wall
from sbm_gym.worlds.rooms.furnishing.arranger import HUNG_GAP_M, Arranger

FRONT_M = 0.6
"""Floor kept free before cabinets."""
WALL_CABINET_M = 1.44
HOOD_M = 1.55
_SEQUENCE = ("kitchen_unit", "kitchen_sink", "kitchen_unit", "cooker", "kitchen_unit", "kitchen_unit", "kitchen_unit")
_SHORT = ("kitchen_sink", "kitchen_unit", "cooker")


_Start = tuple[Wall, float, int]
"""Where a row of cabinets begins: a wall, where along it, and which way it goes (1 or -1)."""


def put_kitchen(a: Arranger, units: int = 5) -> None:
    """A fridge and ``units`` cabinets in rows, along two walls where one is too short; only a fridge for 0."""
    if a.full() or a.pick("fridge") is None:
        return
    sink = a.pick("kitchen_sink") if units else None
    sequence = _SEQUENCE if units > len(_SHORT) else _SHORT
    wanted: list[str] = [] if sink is None else list(sequence[:units])
    kind = "" if sink is None else family(sink)
    # The fridge stands in the corner where the row begins, or somewhere of its own.
    row = _best_row(a, ["fridge", *wanted] if not wanted or a.chance(0.5) else wanted, kind)
    left = list(wanted)
    for piece in row:
        if piece.card.use in left:
            left.remove(piece.card.use)
    row += _best_row(a, left, kind)
    if all(piece.card.use != "fridge" for piece in row) and not _best_row(a, ["fridge"], kind):
        a.along_wall("fridge", front_m=FRONT_M)
    row = [piece for piece in row if piece.card.use != "fridge"]
    if row and a.chance(0.9):
        _hang_over(a, row, kind)
    for piece in row:
        if piece.card.use == "kitchen_unit":
            a.decorate(piece, ("worktop_thing",), 0.5)


def _starts(a: Arranger) -> list[_Start]:
    """Corners, and the places beside doorways, door leaves and cabinets, in random order."""
    starts: list[_Start] = []
    room = a.layout.room
    standing = [piece.box for piece in a.layout.placements if piece.on is None and piece.z_m == 0.0]
    for wall in room.walls():
        low, high = [WALL_GAP_M], [wall.length_m - WALL_GAP_M]
        for opening in room.openings:
            if opening.wall == wall.index and opening.kind != "window":
                low.append(opening.end_m + 0.12)
                high.append(opening.start_m - 0.12)
        for box, beside in [(leaf, 0.08) for leaf in room.leaves] + [(box, 0.001) for box in standing]:
            begin, end, out = wall.shadow(box)
            if out < 0.3:
                low.append(end + beside)
                high.append(begin - beside)
        starts += [(wall, edge, 1) for edge in low] + [(wall, edge, -1) for edge in high]
    return [starts[index] for index in a.rng.permutation(len(starts))]


def _best_row(a: Arranger, wanted: list[str], kind: str) -> list[Placement]:
    """Puts down the longest row that finds a place; returns its pieces."""
    if not wanted:
        return []
    starts = _starts(a)
    # In an inner corner the end of one row hides behind the beginning of the other.
    hidden = [piece.front_zone(FRONT_M) for piece in a.layout.placements if piece.card.use == "kitchen_unit"]
    before = a.layout.mark()
    best: list[Placement] = []
    zones: list[Box] = []
    for start in starts:
        row = _row(a, start, wanted, kind, hidden)
        if len(row) > len(best):
            best, zones = row, a.layout.zones[before[1] :]
        a.layout.undo(before)
        if len(best) == len(wanted):
            break
    a.layout.placements.extend(best)
    a.layout.zones.extend(zones)
    return best


def _row(a: Arranger, start: _Start, wanted: list[str], kind: str, hidden: list[Box]) -> list[Placement]:
    """Pieces side by side from a place on, as many as there is room for; a fridge comes first or not at all."""
    row: list[Placement] = []
    left, (wall, edge, way) = list(wanted), start
    while left:
        # Under a window goes what is low enough.
        for use in dict.fromkeys(left[:1] if left[0] == "fridge" else left):
            card = a.pick(use, _of_kind(kind) if use in ("kitchen_unit", "kitchen_sink") else lambda card: True)
            if card is None:
                continue
            gap = 0.02 if use == "fridge" else 0.0
            centre = edge + way * (card.size_m[0] / 2 + gap)
            piece = _put(a, card, wall, centre, front_m=FRONT_M, ignore_zones=hidden)
            if piece is not None:
                row.append(piece)
                left.remove(use)
                edge = centre + way * (card.size_m[0] / 2 + gap)
                break
        else:
            return row
    return row


def _of_kind(kind: str, most_m: float = np.inf) -> Callable[[ModelCard], bool]:
    """Whether a model belongs to a kitchen, and is not too wide."""
    return lambda card: family(card) == kind and card.size_m[0] <= most_m


def _hang_over(a: Arranger, row: list[Placement], kind: str) -> None:
    """A hood over each cooker, wall cabinets side by side over the rest, where no window is."""
    spans: list[tuple[Wall, float, float]] = []
    for piece in row:
        wall, along = a.wall_behind(piece)
        low, high = along - piece.card.size_m[0] / 2, along + piece.card.size_m[0] / 2
        if piece.card.use == "cooker":
            hood = a.pick("cooker_hood", lambda card: HOOD_M + card.size_m[2] < a.layout.room.height_m)
            if hood is not None:
                _hang(a, hood, wall, along, HOOD_M)
            continue
        last = spans[-1] if spans else None
        if last is not None and last[0].index == wall.index and min(abs(low - last[2]), abs(high - last[1])) < 0.01:
            spans[-1] = (wall, min(low, last[1]), max(high, last[2]))
        else:
            spans.append((wall, low, high))
    for wall, low, high in spans:
        at = low
        while (card := a.pick("wall_cabinet", _of_kind(kind, high - at + 0.002))) is not None:
            hung = _hang(a, card, wall, at + card.size_m[0] / 2, WALL_CABINET_M)
            at += card.size_m[0] if hung is not None else 0.1


def _hang(a: Arranger, card: ModelCard, wall: Wall, along_m: float, elevation_m: float) -> Placement | None:
    return _put(a, card, wall, along_m, elevation_m=elevation_m, gap_m=HUNG_GAP_M, ignore_zones=a.layout.zones)


def _put(a: Arranger, card: ModelCard, wall: Wall, along_m: float, **how) -> Placement | None:
    """Puts a cabinet just there along a wall, close to its neighbours."""
    return a.layout.against_wall(card, walls=[wall.index], centre_m=along_m, tries=1, margin_m=0.0, **how)
