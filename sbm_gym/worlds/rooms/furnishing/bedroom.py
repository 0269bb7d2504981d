"""Beds with what stands around them."""

from sbm_gym.worlds.geometry.placing import Box, Placement
from sbm_gym.worlds.rooms.furnishing.arranger import Arranger
from sbm_gym.worlds.rooms.furnishing.cushions import scatter_cushions


def sleeping(a: Arranger, use: str) -> None:
    """A bed with its head to a wall, nightstands with lamps beside it, perhaps a rug and cushions."""
    bed, stands = None, []
    both = use == "double_bed" and a.chance(0.9)
    walls = a.layout.room.walls()
    for attempt in range(7):
        before = a.layout.mark()
        where = {}
        if both and attempt < 4:  # away from the corners there is room on both sides
            wall = walls[a.rng.integers(4)]
            where = {"walls": [wall.index], "centre_m": 0.5 * wall.length_m, "spread_m": 0.35, "tries": 10}
        bed = a.along_wall(use, front_m=0.5, **where)
        stands = [] if bed is None else _nightstands(a, bed, 2 if both else 1)
        if len(stands) == 2 or (stands and (not both or attempt >= 4)):
            break
        if attempt < 6:
            stands = []
            a.layout.undo(before)  # a bed without room for a nightstand is tried elsewhere
    if not stands:
        bed = a.along_wall(use, front_m=0.5)
    if bed is None:
        return
    for stand in stands:
        a.decorate(stand, ("table_lamp",), 0.8)
    if a.chance(0.5):
        a.rug_before(bed)
    if a.chance(0.8):
        scatter_cushions(a.layout, a.library, bed, int(a.rng.integers(1, 4)))


def _nightstands(a: Arranger, bed: Placement, count: int) -> list[Placement]:
    """Nightstands beside the head of a bed, of one model."""
    card = a.pick("nightstand")
    if card is None or a.full():
        return []
    wall, middle = a.wall_behind(bed)
    placed: list[Placement] = []
    for side in a.rng.permutation([-1, 1]):
        if len(placed) == count:
            break
        along = middle + side * (bed.card.size_m[0] / 2 + card.size_m[0] / 2 + 0.06)
        # One gets up on the first side: floor as long as the bed, wider than the nightstand. The other may be narrow.
        wider = 0.1 if placed else 0.22
        middle_m = wall.point(along + side * (wider - 0.02), card.size_m[1] + 0.85)
        floor = Box(*middle_m, card.size_m[0] / 2 + wider, 0.5 if placed else 0.75, wall.yaw_rad)
        if not a.layout.is_clear(floor):
            continue
        stand = a.layout.against_wall(card, walls=[wall.index], centre_m=float(along), tries=1)
        if stand is not None:
            a.layout.zones.append(floor)
            placed.append(stand)
    return placed
