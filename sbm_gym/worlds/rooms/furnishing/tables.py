"""Tables with their chairs: for meals, for meetings, for work."""

import numpy as np

from sbm_gym.worlds.geometry.placing import Placement, rotation
from sbm_gym.worlds.rooms.furnishing.arranger import Arranger

QUARTERS = (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi)


def dining(a: Arranger, seats: tuple[int, int] = (2, 5)) -> None:
    """A table in the open with chairs around that face it, things on it, perhaps a lamp over it."""
    if a.full():
        return
    for _ in range(3):
        card = a.pick("dining_table")
        if card is None:
            return
        table = a.layout.in_the_open(card, around_m=0.62, yaws=QUARTERS)
        if table is not None:
            break
    else:
        return
    _seats(a, table, int(a.rng.integers(seats[0], seats[1] + 1)))
    a.decorate(table, ("table_thing", "small_plant", "table_thing"), 0.8)
    card = a.pick("hanging_lamp", lambda c: a.layout.room.height_m - c.size_m[2] > 1.7)
    if card is not None and a.chance(0.6):
        z_m = a.layout.room.height_m - card.size_m[2]
        a.layout.add(Placement(card, table.x_m, table.y_m, table.yaw_rad, z_m))


def _seats(a: Arranger, table: Placement, count: int) -> None:
    """Chairs around a table, turned to it."""
    chair = a.pick("dining_chair", copies=count)
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
    for index in a.rng.permutation(len(places)):
        if a.full() or seated == count:
            return
        turn, half, offset = places[index]
        # In the table's axes turned by ``turn``, the chair stands behind (+Y) and looks along -Y, at the table.
        away = half + chair.size_m[1] / 2 + a.rng.uniform(0.03, 0.10)
        x, y = table.at(*(rotation(turn) @ [offset, away]))
        piece = Placement(chair, x, y, float(table.yaw_rad + turn + a.rng.normal(0, 0.08)))
        if a.layout.fits(piece, margin_m=0.02):
            a.layout.add(piece)
            seated += 1


def working(a: Arranger) -> None:
    """A desk against a wall with a chair before it, a lamp and things on it."""
    desk = a.along_wall("desk", front_m=0.9)
    if desk is None:
        return
    card = a.pick("office_chair" if a.chance(0.75) else "dining_chair")
    if card is not None and not a.full():
        # The catalogue's desks show their front (drawers, modesty panel aside) to whoever sits there.
        x, y = desk.at(a.rng.uniform(-0.12, 0.12), -(desk.card.size_m[1] + card.size_m[1]) / 2 - 0.05)
        piece = Placement(card, x, y, desk.yaw_rad + np.pi + a.rng.normal(0, 0.3))
        if a.layout.fits(piece, margin_m=0.01, ignore_zones=a.layout.zones):
            a.layout.add(piece)
    a.decorate(desk, ("desk_thing", "desk_lamp", "desk_thing"), 0.75)
