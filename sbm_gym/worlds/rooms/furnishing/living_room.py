"""Couches with what stands before them, televisions, and single seats."""

from typing import Any

import numpy as np

from sbm_gym.worlds.geometry.placing import Placement
from sbm_gym.worlds.rooms.furnishing.arranger import Arranger
from sbm_gym.worlds.rooms.furnishing.cushions import scatter_cushions


def sitting(a: Arranger, *, lounge: float = 0.6, television: bool = True, second: float = 0.0) -> None:
    """A couch against a wall, a low table and a rug before it, a television opposite, perhaps more seats.

    Args:
        a: the room.
        lounge: how likely an armchair stands at one end of the low table.
        television: whether there is one.
        second: how likely a second couch stands there instead.
    """
    couch = a.along_wall("couch", front_m=1.0)
    if couch is None:
        return
    if a.chance(0.9):
        scatter_cushions(a.layout, a.library, couch, int(a.rng.integers(2, 6)))
    zones = tuple(a.layout.zones)
    low = a.pick("coffee_table")
    table = None
    if low is not None and not a.full() and a.chance(0.85):
        before = couch.at(a.rng.uniform(-0.15, 0.15), -(couch.card.size_m[1] / 2 + 0.38 + low.size_m[1] / 2))
        piece = Placement(low, *before, couch.yaw_rad)
        if a.layout.fits(piece, ignore_zones=zones):
            table = a.layout.add(piece)
            a.decorate(table, ("table_thing", "small_plant"), 0.6)
    a.rug_before(couch)
    if television:
        put_television(a, couch)
    if a.chance(second) and _second_couch(a, couch, table):
        return
    if table is not None and a.chance(lounge):
        _seat_at(a, "lounge_chair", table, couch)


def _second_couch(a: Arranger, couch: Placement, table: Placement | None) -> bool:
    """A small couch at one end of the low table, or along another wall."""
    other = None if table is None else _seat_at(a, "couch", table, couch)
    if other is None:
        other = a.along_wall("couch", front_m=0.8)
    if other is None:
        return False
    if a.chance(0.8):
        scatter_cushions(a.layout, a.library, other, int(a.rng.integers(1, 4)))
    return True


def _seat_at(a: Arranger, use: str, table: Placement, couch: Placement) -> Placement | None:
    """A seat at one end of the low table: an armchair half turned to the couch, a couch square to it."""
    card = a.pick(use, lambda card: card.size_m[0] < 1.9 and card.size_m[1] < 1.1)
    if card is None or a.full():
        return None
    for side in a.rng.permutation([-1, 1]):
        away = table.card.size_m[0] / 2 + card.size_m[1] / 2 + a.rng.uniform(0.25, 0.45)
        # To its right (+x) the table lies at the left: the front must turn from -Y of the couch towards -x.
        yaw = couch.yaw_rad - side * (0.5 * np.pi)
        if use != "couch":
            yaw += side * a.rng.uniform(-0.5, 0.1)
        piece = Placement(card, *table.at(side * away, -0.1), float(yaw))
        if a.layout.fits(piece, ignore_zones=a.layout.zones[-1:]):
            return a.layout.add(piece)
    return None


def put_television(a: Arranger, watcher: Placement | None = None, supports: tuple[str, ...] = ("tv_stand",)) -> None:
    """A television on a low cabinet or on the wall, opposite ``watcher`` where that is possible."""
    if a.full():
        return
    where: dict[str, Any] = {}
    if watcher is not None:
        opposite = a.layout.room.walls()[(a.wall_behind(watcher)[0].index + 2) % 4]
        centre = float((np.array([watcher.x_m, watcher.y_m]) - opposite.origin) @ opposite.along)
        where = {"walls": [opposite.index], "centre_m": centre, "spread_m": 0.5}
    on_wall = a.chance(0.35)
    for attempt in range(5):
        if attempt == 2:
            where, on_wall = {}, False
        card = a.pick("wall_tv") if on_wall else None
        if card is not None and a.layout.against_wall(card, elevation_m=a.rng.uniform(0.95, 1.2), **where):
            return
        before = a.layout.mark()
        card, screen = a.pick(str(a.rng.choice(supports))), a.pick("tv")
        stand = card and a.layout.against_wall(card, **where)
        if stand is None or screen is None:
            continue
        if a.layout.on_top(screen, stand, 0.0, 0.02):
            return
        a.layout.undo(before)  # under a window, or too narrow: no place for a screen


def lounging(a: Arranger, use: str = "lounge_chair") -> None:
    """An armchair or beanbag near a wall, turned into the room."""
    card = None if a.full() else a.pick(use)
    if card is None:
        return
    (x0, y0), (x1, y1) = a.layout.room.low_m, a.layout.room.high_m
    for _ in range(100):
        x, y = a.rng.uniform(x0 + 0.5, x1 - 0.5), a.rng.uniform(y0 + 0.5, y1 - 0.5)
        if min(x - x0, x1 - x, y - y0, y1 - y) >= 1.1:
            continue
        yaw = np.arctan2(0.5 * (x0 + x1) - x, y - 0.5 * (y0 + y1)) + a.rng.normal(0, 0.35)
        piece = Placement(card, x, y, float(yaw))
        zone = piece.front_zone(0.6)
        if a.layout.fits(piece, margin_m=0.1) and a.layout.is_clear(zone):
            a.layout.add(piece, zone)
            return
