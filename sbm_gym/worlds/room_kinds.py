"""Kinds of rooms: which groups of furniture each is made of."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sbm_gym.assets.library import FurnitureLibrary
from sbm_gym.worlds.arrange import Arranger
from sbm_gym.worlds.placing import Layout, Placement

OBJECTS_PER_M2 = (0.38, 0.6)
"""A room is filled up to a number of objects drawn from here, cushions aside, as far as there is room."""


def _living_room(a: Arranger) -> None:
    a.sitting()
    a.greening()
    a.storing("shelf")
    if a.chance(0.35):
        a.dining((2, 4))
    a.lamp()
    if a.chance(0.6):
        a.greening()
    if a.chance(0.85):
        a.lounging("beanbag" if a.chance(0.8) else "lounge_chair")
    if a.chance(0.4):
        a.storing("dresser", ("small_plant", "table_lamp"))


def _bedroom(a: Arranger) -> None:
    a.sleeping("double_bed" if a.chance(0.75) else "single_bed")
    a.storing("cupboard")
    if a.chance(0.4):
        a.working()
    if a.chance(0.35):
        a.television(supports=("tv_stand", "dresser"))
    elif a.chance(0.6):
        a.storing("dresser", ("table_lamp", "small_plant"))
    if a.chance(0.5):
        a.lounging("beanbag" if a.chance(0.65) else "lounge_chair")
    a.greening()


def _study(a: Arranger) -> None:
    a.working()
    a.storing("shelf")
    if a.chance(0.5):
        a.sleeping("single_bed")
    if a.chance(0.6):
        a.lounging("beanbag" if a.chance(0.5) else "lounge_chair")
    a.greening()
    if a.chance(0.5):
        a.storing("shelf")


def _studio(a: Arranger) -> None:
    a.sleeping("double_bed" if a.chance(0.5) else "single_bed")
    a.kitchen(3)
    a.sitting(lounge=0.2)
    a.dining((2, 3))
    a.greening()
    if a.chance(0.6):
        a.storing("shelf")
    if a.chance(0.6):
        a.lounging("beanbag")


def _office(a: Arranger) -> None:
    for _ in range(int(a.rng.integers(2, 4))):
        a.working()
    a.storing("shelf")
    a.greening()
    if a.chance(0.55):
        a.sitting(lounge=0.5, television=a.chance(0.5))
    a.small("office_cabinet")
    a.small("bin")
    a.greening()
    if a.chance(0.5):
        a.storing("shelf")
    if a.chance(0.7):
        a.lounging("beanbag")


def _meeting_room(a: Arranger) -> None:
    a.dining((4, 6))
    a.television()
    a.greening()
    if a.chance(0.5):
        a.storing("shelf")


def _hotel_room(a: Arranger) -> None:
    a.sleeping("double_bed")
    if a.chance(0.3):
        a.sleeping("single_bed")
    if a.chance(0.7):
        a.kitchen(0)
    a.television(supports=("tv_stand", "dresser"))
    a.working()
    a.lounging()
    a.storing("cupboard")
    a.greening()
    a.lamp()


def _kitchen_diner(a: Arranger) -> None:
    a.kitchen(4)
    a.dining((3, 6))
    a.greening()
    if a.chance(0.3):
        a.television()
    if a.chance(0.5):
        a.storing("shelf")
    a.small("bin")


def _kitchen(a: Arranger) -> None:
    a.kitchen(4)
    if a.chance(0.6):
        a.dining((1, 2))
    a.small("bin")
    a.greening()


def _hall(a: Arranger) -> None:
    if a.chance(0.5):
        a.storing("shelf")
    if a.chance(0.5):
        a.greening()


def _bathroom(a: Arranger) -> None:
    a.bathing(tub=a.chance(0.7))
    a.small("bin")
    if a.chance(0.3):
        a.greening()


def _wash_room(a: Arranger) -> None:
    a.bathing()
    a.small("bin")


@dataclass(frozen=True)
class RoomKind:
    """How a kind of room is furnished."""

    furnish: Callable[[Arranger], None]
    needed: tuple[str, ...] = ()
    """Classes without which a room is not of its kind."""
    extras: tuple[str, ...] = ()
    """What it may be filled up with, see ``Arranger.fill``."""
    pictures: int = 3
    """The most that hang on its walls."""


ROOM_KINDS: dict[str, RoomKind] = {
    "living_room": RoomKind(_living_room, ("couch", "tv"), ("armchair", "beanbag", "shelf", "chair", "dresser")),
    "kitchen_diner": RoomKind(_kitchen_diner, ("fridge", "table", "chair"), ("chair", "shelf")),
    "kitchen": RoomKind(_kitchen, ("fridge",), pictures=1),
    "hall": RoomKind(_hall, pictures=2),
    "bedroom": RoomKind(_bedroom, ("bed", "nightstand"), ("armchair", "beanbag", "shelf", "chair", "desk")),
    "study": RoomKind(_study, ("table", "chair"), ("plant", "shelf", "beanbag", "chair")),
    "bathroom": RoomKind(_bathroom, ("toilet",), pictures=1),
    "wash_room": RoomKind(_wash_room, ("toilet",), pictures=1),
    "studio": RoomKind(_studio, ("bed", "fridge", "table"), ("plant", "armchair", "beanbag", "shelf", "chair")),
    "hotel_room": RoomKind(_hotel_room, ("bed", "tv", "nightstand"), ("plant", "armchair", "chair", "shelf")),
    "office": RoomKind(_office, ("table", "chair"), ("shelf", "chair", "desk", "beanbag")),
    "meeting_room": RoomKind(_meeting_room, ("table", "chair"), ("chair", "shelf")),
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
    arranger.fill(round(area_m2 * float(arranger.rng.uniform(*OBJECTS_PER_M2))), described.extras)
    arranger.radiator()
    return arranger.rugs
