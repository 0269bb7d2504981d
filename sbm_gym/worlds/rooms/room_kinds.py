"""Kinds of rooms: which groups of furniture each is made of."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.worlds.geometry.placing import Layout, Placement
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
    if a.chance(0.3):
        lounging(a, "beanbag")
    greening(a)
    storing(a, "shelf")
    if a.chance(0.35):
        dining(a, (2, 4))
    standing_lamp(a)
    if a.chance(0.6):
        greening(a)
    if a.chance(0.4):
        storing(a, "dresser", ("small_plant", "table_lamp"))
    if a.chance(0.3):
        a.hang("wall_clock", 1.75)


def _bedroom(a: Arranger) -> None:
    sleeping(a, "double_bed" if a.chance(0.75) else "single_bed")
    if a.chance(0.7):
        lounging(a, "beanbag" if a.chance(0.8) else "lounge_chair")
    storing(a, "cupboard")
    if a.chance(0.4):
        working(a)
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
    if a.chance(0.5):
        storing(a, "shelf")


def _studio(a: Arranger) -> None:
    sleeping(a, "double_bed" if a.chance(0.5) else "single_bed")
    put_kitchen(a, 3)
    sitting(a, lounge=0.2)
    dining(a, (2, 3))
    greening(a)
    if a.chance(0.6):
        storing(a, "shelf")
    if a.chance(0.8):
        lounging(a, "beanbag")
    storing(a, "cupboard")


def _office(a: Arranger) -> None:
    for _ in range(int(a.rng.integers(2, 5))):
        working(a)
    if a.chance(0.8):
        a.hang("whiteboard", 0.95)
    storing(a, "shelf")
    greening(a)
    if a.chance(0.85):
        sitting(a, lounge=0.5, television=a.chance(0.5))
    if a.chance(0.85):
        lounging(a, "beanbag")
    a.small("office_cabinet")
    a.small("bin")
    a.hang("wall_clock", 1.8)
    greening(a)
    a.small("office_cabinet")
    if a.chance(0.5):
        storing(a, "shelf")


def _meeting_room(a: Arranger) -> None:
    dining(a, (4, 6))
    a.hang("whiteboard", 0.95)
    put_television(a)
    greening(a)
    if a.chance(0.5):
        storing(a, "shelf")
    if a.chance(0.5):
        storing(a, "dresser", ("small_plant",))


def _hotel_room(a: Arranger) -> None:
    sleeping(a, "double_bed")
    if a.chance(0.5):
        sleeping(a, "single_bed")
    if a.chance(0.7):
        put_kitchen(a, 0)
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
    if a.chance(0.3):
        put_television(a)
    if a.chance(0.5):
        storing(a, "shelf")
    a.small("bin")
    if a.chance(0.5):
        a.hang("wall_clock", 1.8)


def _kitchen(a: Arranger) -> None:
    put_kitchen(a, 7)
    if a.chance(0.7):
        dining(a, (1, 2))
    a.small("bin")
    greening(a)
    if a.chance(0.5):
        a.hang("wall_clock", 1.8)


def _hall(a: Arranger) -> None:
    entering(a)
    if a.chance(0.5):
        storing(a, "shelf")
    if a.chance(0.5):
        greening(a)


def _bathroom(a: Arranger) -> None:
    bathing(a, "bathtub" if a.chance(0.6) else "shower")
    a.small("bin")
    if a.chance(0.3):
        greening(a)


def _wash_room(a: Arranger) -> None:
    bathing(a)
    a.small("bin")


@dataclass(frozen=True)
class RoomKind:
    """How a kind of room is furnished."""

    furnish: Callable[[Arranger], None]
    needed: tuple[str, ...] = ()
    """Classes without which a room is not of its kind."""
    expected: tuple[str, ...] = ()
    """Uses without a class that it should have too."""
    extras: tuple[str, ...] = ()
    """What it may be filled up with, see ``fill``."""
    pictures: int = 4
    """The most that hang on its walls."""


ROOM_KINDS: dict[str, RoomKind] = {
    "living_room": RoomKind(_living_room, ("couch", "tv"), extras=("armchair", "beanbag", "plant", "chair", "dresser")),
    "kitchen_diner": RoomKind(
        _kitchen_diner, ("fridge", "table", "chair"), ("kitchen_sink", "cooker"), ("chair", "plant", "shelf")
    ),
    "kitchen": RoomKind(_kitchen, ("fridge",), ("kitchen_sink", "cooker"), pictures=1),
    "hall": RoomKind(_hall, pictures=3),
    "bedroom": RoomKind(
        _bedroom, ("bed", "nightstand"), extras=("armchair", "beanbag", "plant", "shelf", "chair", "desk")
    ),
    "study": RoomKind(_study, ("table", "chair"), extras=("plant", "beanbag", "armchair", "chair")),
    "bathroom": RoomKind(_bathroom, ("toilet",), ("washbasin",), pictures=1),
    "wash_room": RoomKind(_wash_room, ("toilet",), ("washbasin",), pictures=1),
    "studio": RoomKind(_studio, ("bed", "fridge", "table"), extras=("plant", "armchair", "beanbag", "shelf", "chair")),
    "hotel_room": RoomKind(_hotel_room, ("bed", "tv", "nightstand"), extras=("plant", "armchair", "chair", "shelf")),
    "office": RoomKind(_office, ("table", "chair"), extras=("plant", "shelf", "chair", "desk", "beanbag")),
    "meeting_room": RoomKind(_meeting_room, ("table", "chair"), extras=("chair", "shelf")),
}
"""What furnishes each kind of room."""


def furnish(kind: str, layout: Layout, library: FurnitureLibrary, max_triangles: int) -> list[Placement]:
    """Furnishes a room of a kind.

    Args:
        kind: a key of ``ROOM_KINDS``.
        layout: the empty room; its placements are filled.
        library: where the furniture comes from.
        max_triangles: of all pieces together.

    Returns:
        The rugs, which lie under what stands on them.
    """
    area_m2 = float(np.prod(layout.room.size_m))
    arranger = Arranger(layout, library, max_triangles, max_objects=int(np.clip(round(0.7 * area_m2), 3, 14)))
    described = ROOM_KINDS[kind]
    described.furnish(arranger)
    fill(arranger, round(area_m2 * float(arranger.rng.uniform(*OBJECTS_PER_M2))), described.extras)
    radiator(arranger)
    return arranger.rugs
