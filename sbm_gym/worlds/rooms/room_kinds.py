"""Kinds of rooms: which groups of furniture each is made of."""

import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.worlds.geometry.placing import Layout
from sbm_gym.worlds.rooms.floor_plan import ROOM_KINDS
from sbm_gym.worlds.rooms.furnishing.arranger import Arranger
from sbm_gym.worlds.rooms.furnishing.bathroom import bathing
from sbm_gym.worlds.rooms.furnishing.bedroom import sleeping
from sbm_gym.worlds.rooms.furnishing.extras import dressing, entering, fill, greening, radiator, standing_lamp, storing
from sbm_gym.worlds.rooms.furnishing.kitchen import put_kitchen
from sbm_gym.worlds.rooms.furnishing.living_room import lounging, put_television, sitting
from sbm_gym.worlds.rooms.furnishing.tables import dining, working

OBJECTS_PER_M2 = (0.38, 0.6)
"""A room is filled up to a number of objects drawn from here, cushions aside, as far as there is room."""


def _living_room(a: Arranger) -> None:
    sitting(a, second=0.55)
    if a.chance(0.9):
        lounging(a, "beanbag" if a.chance(0.9) else "lounge_chair")
    a.perhaps(0.3, lounging, "beanbag")
    greening(a)
    storing(a, "shelf")
    a.perhaps(0.35, dining, (2, 4))
    standing_lamp(a)
    a.perhaps(0.6, greening)
    a.perhaps(0.4, storing, "dresser", ("small_plant", "table_lamp"))
    a.perhaps(0.3, Arranger.hang, "wall_clock", 1.75)


def _bedroom(a: Arranger) -> None:
    sleeping(a, "double_bed" if a.chance(0.75) else "single_bed")
    if a.chance(0.7):
        lounging(a, "beanbag" if a.chance(0.8) else "lounge_chair")
    storing(a, "cupboard")
    a.perhaps(0.4, working)
    if a.chance(0.35):
        put_television(a, supports=("tv_stand", "dresser"))
    elif a.chance(0.7):
        dressing(a)
    greening(a)


def _study(a: Arranger) -> None:
    working(a)
    storing(a, "shelf")
    if a.chance(0.8):
        if a.chance(0.6):
            sleeping(a, "single_bed")
        else:
            sitting(a, lounge=0.0, television=False)
    if a.chance(0.7):
        lounging(a, "beanbag" if a.chance(0.7) else "lounge_chair")
    greening(a)
    a.perhaps(0.5, storing, "shelf")


def _studio(a: Arranger) -> None:
    sleeping(a, "double_bed" if a.chance(0.5) else "single_bed")
    put_kitchen(a, 3)
    sitting(a, lounge=0.2)
    dining(a, (2, 3))
    greening(a)
    a.perhaps(0.6, storing, "shelf")
    a.perhaps(0.8, lounging, "beanbag")
    storing(a, "cupboard")


def _office(a: Arranger) -> None:
    for _ in range(int(a.rng.integers(2, 5))):
        working(a)
    a.perhaps(0.8, Arranger.hang, "whiteboard", 0.95)
    storing(a, "shelf")
    greening(a)
    if a.chance(0.85):
        sitting(a, lounge=0.5, television=a.chance(0.5))
    a.perhaps(0.85, lounging, "beanbag")
    a.small("office_cabinet")
    a.small("bin")
    a.hang("wall_clock", 1.8)
    greening(a)
    a.small("office_cabinet")
    a.perhaps(0.5, storing, "shelf")


def _meeting_room(a: Arranger) -> None:
    dining(a, (4, 6))
    a.hang("whiteboard", 0.95)
    put_television(a)
    greening(a)
    a.perhaps(0.5, storing, "shelf")
    a.perhaps(0.5, storing, "dresser", ("small_plant",))


def _hotel_room(a: Arranger) -> None:
    sleeping(a, "double_bed")
    a.perhaps(0.5, sleeping, "single_bed")
    a.perhaps(0.7, put_kitchen, 0)
    put_television(a, supports=("tv_stand", "dresser"))
    working(a)
    if a.chance(0.4):
        sitting(a, lounge=0.3, television=False)
    else:
        lounging(a)
    storing(a, "cupboard")
    greening(a)
    standing_lamp(a)


def _kitchen_diner(a: Arranger) -> None:
    put_kitchen(a, 5)
    dining(a, (3, 6))
    greening(a)
    a.perhaps(0.3, put_television)
    a.perhaps(0.5, storing, "shelf")
    a.small("bin")
    a.perhaps(0.5, Arranger.hang, "wall_clock", 1.8)


def _kitchen(a: Arranger) -> None:
    put_kitchen(a, 7)
    a.perhaps(0.7, dining, (1, 2))
    a.small("bin")
    greening(a)
    a.perhaps(0.5, Arranger.hang, "wall_clock", 1.8)


def _hall(a: Arranger) -> None:
    entering(a)
    a.perhaps(0.5, storing, "shelf")
    a.perhaps(0.5, greening)


def _bathroom(a: Arranger) -> None:
    bathing(a, "bathtub" if a.chance(0.6) else "shower")
    a.small("bin")
    a.perhaps(0.3, greening)


def _wash_room(a: Arranger) -> None:
    bathing(a)
    a.small("bin")


_GROUPS = (
    *(_living_room, _kitchen_diner, _kitchen, _hall, _bedroom, _study, _bathroom, _wash_room),
    *(_studio, _hotel_room, _office, _meeting_room),
)
FURNISH = {groups.__name__.removeprefix("_"): groups for groups in _GROUPS}
"""What furnishes each kind of room."""


def furnish(layout: Layout, library: FurnitureLibrary, max_triangles: int) -> None:
    """Furnishes an empty room as its kind asks.

    Args:
        layout: the room; its placements are filled.
        library: where the furniture comes from.
        max_triangles: of all pieces together.
    """
    area_m2 = float(np.prod(layout.room.size_m))
    arranger = Arranger(layout, library, max_triangles, max_objects=int(np.clip(round(0.7 * area_m2), 3, 14)))
    FURNISH[layout.room.kind](arranger)
    target = round(area_m2 * float(arranger.rng.uniform(*OBJECTS_PER_M2)))
    fill(arranger, target, ROOM_KINDS[layout.room.kind].extras)
    radiator(arranger)
