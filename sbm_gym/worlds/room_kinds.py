"""Kinds of rooms: which groups of furniture each is made of."""

from collections.abc import Callable

from sbm_gym.assets.library import FurnitureLibrary
from sbm_gym.worlds.arrange import Arranger
from sbm_gym.worlds.placing import Layout, Placement

FILL_TO = (8, 13)
"""A room with fewer objects than a number drawn from here (both included) gets more, as far as there is room."""


def _living_room(a: Arranger) -> None:
    a.sitting()
    a.greening()
    a.storing("shelf")
    if a.chance(0.6):
        a.dining((2, 4))
    a.lamp()
    a.greening()
    if a.chance(0.5):
        a.lounging("beanbag" if a.chance(0.4) else "lounge_chair")
    if a.chance(0.5):
        a.storing("dresser", ("small_plant", "table_lamp"))


def _bedroom(a: Arranger) -> None:
    a.sleeping("double_bed" if a.chance(0.8) else "single_bed")
    a.storing("cupboard")
    if a.chance(0.45):
        a.bathing()
    if a.chance(0.6):
        a.working()
    if a.chance(0.5):
        a.television(supports=("tv_stand", "dresser"))
    else:
        a.storing("dresser", ("table_lamp", "small_plant"))
    a.lounging()
    a.greening()
    if a.chance(0.5):
        a.storing("shelf")


def _studio(a: Arranger) -> None:
    a.sleeping("double_bed" if a.chance(0.5) else "single_bed")
    a.kitchen(2)
    a.sitting(lounge=0.2)
    a.bathing()
    a.dining((2, 3))
    a.greening()
    if a.chance(0.5):
        a.storing("shelf")


def _office(a: Arranger) -> None:
    if a.chance(0.6):
        a.kitchen(int(a.rng.integers(0, 3)))
    for _ in range(int(a.rng.integers(2, 4))):
        a.working()
    a.storing("shelf")
    a.greening()
    if a.chance(0.6):
        a.sitting(lounge=0.5, television=a.chance(0.4))
    else:
        a.dining((3, 6))
    if a.chance(0.15):
        a.bathing()
    a.small("office_cabinet")
    a.small("bin")
    a.greening()
    if a.chance(0.5):
        a.storing("shelf")


def _hotel_room(a: Arranger) -> None:
    a.sleeping("double_bed")
    if a.chance(0.3):
        a.sleeping("single_bed")
    a.bathing()
    if a.chance(0.6):
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
    if a.chance(0.5):
        a.sitting(lounge=0.2)
    else:
        a.television()
    a.storing("shelf")
    if a.chance(0.15):
        a.bathing()
    a.small("bin")
    a.greening()


ROOM_KINDS: dict[str, Callable[[Arranger], None]] = {
    "living_room": _living_room,
    "bedroom": _bedroom,
    "studio": _studio,
    "office": _office,
    "hotel_room": _hotel_room,
    "kitchen_diner": _kitchen_diner,
}
"""What furnishes each kind of room."""

NEEDED: dict[str, tuple[str, ...]] = {
    "living_room": ("couch", "tv"),
    "bedroom": ("bed",),
    "studio": ("bed", "fridge", "toilet", "table"),
    "office": ("table", "chair"),
    "hotel_room": ("bed", "toilet", "tv"),
    "kitchen_diner": ("fridge", "table", "chair"),
}
"""Classes without which a room is not of its kind."""


def furnish(kind: str, layout: Layout, library: FurnitureLibrary) -> list[Placement]:
    """Furnishes a room of a kind.

    Args:
        kind: a key of ``ROOM_KINDS``.
        layout: the empty room; its placements are filled.
        library: where the furniture comes from.

    Returns:
        The rugs, which lie under what stands on them.
    """
    arranger = Arranger(layout, library)
    ROOM_KINDS[kind](arranger)
    arranger.fill(int(arranger.rng.integers(FILL_TO[0], FILL_TO[1] + 1)))
    arranger.radiator()
    return arranger.rugs
