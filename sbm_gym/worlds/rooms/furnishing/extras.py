"""Single pieces: what stores things, plants, lamps, what hangs on walls; and filling a room up with them."""

from typing import Any

from sbm_gym.worlds.rooms.furnishing.arranger import Arranger
from sbm_gym.worlds.rooms.furnishing.living_room import lounging
from sbm_gym.worlds.rooms.furnishing.tables import working


def storing(a: Arranger, use: str, top: tuple[str, ...] = ()) -> None:
    """A shelf, cupboard or dresser against a wall; perhaps things on it."""
    piece = a.along_wall(use, front_m=0.45)
    if piece is not None and top:
        a.decorate(piece, top, 0.7)


def dressing(a: Arranger) -> None:
    """A chest of drawers with a mirror over it."""
    chest = a.along_wall("dresser", front_m=0.45)
    if chest is None:
        return
    wall, along = a.wall_behind(chest)
    a.hang("mirror", max(chest.card.size_m[2] + 0.12, 1.05), walls=[wall.index], centre_m=along, tries=1)
    a.decorate(chest, ("table_lamp", "small_plant"), 0.5)


def greening(a: Arranger) -> None:
    """A plant in a corner, else somewhere along a wall."""
    if a.full():
        return
    card = a.pick("floor_plant")
    if card is not None and a.layout.against_wall(card, corner=True, tries=8) is None:
        a.layout.against_wall(card, tries=20)


def standing_lamp(a: Arranger) -> None:
    """A standard lamp along a wall."""
    a.small("floor_lamp", corner=a.chance(0.5))


def entering(a: Arranger) -> None:
    """What one finds behind a front door: coats, a mirror, a place for keys, a runner."""
    if a.chance(0.85):
        a.hang("coat_rack", 0.9)
    if a.chance(0.5):
        dressing(a)
    elif a.chance(0.5):
        a.hang("mirror", 1.05)


def radiator(a: Arranger) -> None:
    """A radiator under a window."""
    for opening in a.layout.room.openings:
        card = a.pick("radiator", lambda card: card.size_m[2] < 0.75)
        if opening.kind == "window" and card is not None:
            middle = 0.5 * (opening.start_m + opening.end_m)
            a.layout.against_wall(card, walls=[opening.wall], centre_m=middle, spread_m=0.2, tries=3)


EXTRAS: dict[str, tuple[Any, ...]] = {
    "plant": (greening,),
    "armchair": (lounging,),
    "beanbag": (lounging, "beanbag"),
    "shelf": (storing, "shelf"),
    "chair": (lounging, "dining_chair"),
    "desk": (working,),
    "dresser": (storing, "dresser", ("small_plant",)),
}
"""What a room may be filled up with: a function and its arguments after the room."""


def fill(a: Arranger, target: int, extras: tuple[str, ...]) -> None:
    """Adds single pieces, ``EXTRAS``, until there are ``target`` objects (cushions aside), as far as there is room."""
    for _ in range(10):
        if not extras or a.count() >= target:
            return
        furnish, *what = EXTRAS[extras[a.rng.integers(len(extras))]]
        furnish(a, *what)
