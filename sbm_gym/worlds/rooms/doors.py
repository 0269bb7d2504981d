"""Where door leaves stand: open, in one of the two rooms of a doorway, along the wall beside it or folded back."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sbm_gym.worlds.geometry.placing import Box, Opening, Room, Wall, overlap

LEAF_M = 0.04
"""Thickness of a leaf."""
LEAF_HEIGHT_M = 2.03
WIDEST_M = 1.1
"""Wider doorways have no leaf."""
_OUT_M = 0.03
"""From the wall to the hinge, beyond the frame."""
_BESIDE_M = 0.035
"""From the clear width to the middle of a leaf that stands square to its wall."""
_FOLDED_M = 0.085
"""From the wall to the middle of a leaf that lies against it: room for the handle."""
_CORNER_M = 0.4
"""A leaf stands square to its wall only where another wall is as near as this."""


def hang_leaves(
    rooms: Sequence[Room], doorways: Sequence[tuple[int, int, float]], rng: np.random.Generator
) -> list[Room]:
    """Hangs leaves in doorways, standing open, clear of all doorways and windows.

    Args:
        rooms: the rooms with their openings.
        doorways: the two rooms of each doorway, the one that its leaf should rather stand in first, and how likely
            it has a leaf. They come in the order in which the rooms list their passages.
        rng: source of randomness.

    Returns:
        The rooms with the leaves that stand in them.
    """
    hung = list(rooms)
    passages = [[opening for opening in room.openings if opening.kind == "passage"] for room in rooms]
    for first, second, probability in doorways:
        sides = [(index, passages[index].pop(0)) for index in sorted((first, second))]
        sides.sort(key=lambda side: side[0] != first)
        width = sides[0][1].end_m - sides[0][1].start_m
        wanted = rng.random() < probability
        turn, pick = float(rng.uniform(0.0, 0.07)), rng.random()
        if not wanted or width > WIDEST_M:
            continue
        for index, opening in sides:
            found = [leaf for leaf in _ways(hung[index], opening, turn) if _stands_clear(hung[index], opening, leaf)]
            if found:
                leaf = found[int(pick * len(found))]
                hung[index] = replace(hung[index], leaves=(*hung[index].leaves, leaf))
                break
    return hung


def _ways(room: Room, opening: Opening, turn_rad: float) -> Iterator[Box]:
    """Leaves of an opening as they could stand in a room. Their own x axis runs from the hinge to the handle."""
    wall = room.walls()[opening.wall]
    half = 0.5 * (opening.end_m - opening.start_m) - 0.01
    for hinge, away, corner in (
        (opening.start_m, -1.0, opening.start_m),
        (opening.end_m, 1.0, wall.length_m - opening.end_m),
    ):
        if corner <= _CORNER_M:
            # Opened a little further than square, towards the other wall.
            yield _leaf(wall, hinge + away * _BESIDE_M, _OUT_M, (away * math.sin(turn_rad), math.cos(turn_rad)), half)
        yield _leaf(wall, hinge + away * 0.02, _FOLDED_M, (away, 0.0), half)


def _leaf(wall: Wall, along_m: float, out_m: float, way: tuple[float, float], half_m: float) -> Box:
    middle = wall.point(along_m + half_m * way[0], out_m + half_m * way[1])
    direction = way[0] * wall.along + way[1] * wall.normal
    yaw = math.atan2(float(direction[1]), float(direction[0]))
    return Box(*middle, half_m, 0.5 * LEAF_M, yaw, 0.0, LEAF_HEIGHT_M)


def _stands_clear(room: Room, own: Opening, leaf: Box) -> bool:
    """Whether a leaf is inside the room, hides no window and stands in the way of no door."""
    x0, y0, x1, y1 = leaf.bounds()
    if min(x0 - room.low_m[0], y0 - room.low_m[1], room.high_m[0] - x1, room.high_m[1] - y1) < 0.02:
        return False
    walls = room.walls()
    for opening in room.openings:
        low, high, out = walls[opening.wall].shadow(leaf)
        reach = 0.35 if opening.kind == "window" else 1.1
        beside = 0.32 if opening.kind == "window" else 0.1
        if opening is own:
            reach, beside = 1.1, -0.005
        if out < reach and high > opening.start_m - beside and low < opening.end_m + beside:
            return False
    return not any(overlap(leaf, other, 0.15) for other in room.leaves)
