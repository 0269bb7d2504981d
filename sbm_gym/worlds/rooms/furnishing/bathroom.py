"""Bathrooms: a toilet, a basin under a mirror, a bath or a shower, towels."""

from sbm_gym.worlds.geometry.placing import Placement
from sbm_gym.worlds.rooms.furnishing.arranger import Arranger

MIRROR_M = 1.15
BATHING_ATTEMPTS = 8
"""How often a bathroom is laid out until all of it finds a place."""


def bathing(a: Arranger, wash: str | None = None) -> None:
    """A toilet against a wall, a basin with a mirror, towels, and ``wash``, a bathtub or shower, in a corner."""
    for attempt in range(BATHING_ATTEMPTS):
        before = a.layout.mark()
        # What takes most room goes first, and is the first to be given up.
        chosen = wash if attempt < BATHING_ATTEMPTS // 2 else "shower" if wash is not None else None
        front_m = 0.4 if attempt < BATHING_ATTEMPTS // 2 else 0.28
        tub = None if chosen is None else a.along_wall(chosen, corner=True, front_m=front_m)
        toilet = a.along_wall("toilet", front_m=0.5)
        basin = None if toilet is None else _basin(a, toilet)
        if basin is not None and (chosen is None or tub is not None):
            break
        if attempt < BATHING_ATTEMPTS - 1:
            a.layout.undo(before)
    if toilet is None:
        return
    if basin is not None and basin.card.size_m[2] < MIRROR_M - 0.02:
        wall, along = a.wall_behind(basin)
        a.hang("mirror", MIRROR_M, walls=[wall.index], centre_m=along, tries=1)
    if tub is not None:
        a.rug_before(tub, "bath_mat")
    if a.chance(0.9):
        a.hang("towel_rail", float(a.rng.uniform(0.8, 0.95)))
    if a.chance(0.35):
        a.small("washing_machine", front_m=0.4)


def _basin(a: Arranger, toilet: Placement) -> Placement | None:
    """A basin beside the toilet, else anywhere."""
    wall, middle = a.wall_behind(toilet)
    for _ in range(3):
        card = a.pick("washbasin")
        if card is None:
            return None
        for side in a.rng.permutation([-1, 1]):
            offset = side * (toilet.card.size_m[0] / 2 + card.size_m[0] / 2 + 0.25)
            basin = a.layout.against_wall(
                card, walls=[wall.index], centre_m=float(middle + offset), spread_m=0.1, front_m=0.45, tries=4
            )
            if basin is not None:
                return basin
        basin = a.layout.against_wall(card, front_m=0.45, tries=15)
        if basin is not None:
            return basin
    return None
