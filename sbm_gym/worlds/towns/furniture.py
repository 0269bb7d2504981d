"""Furnishes a town: parks and squares, bus stops, junctions, kerbs."""

import numpy as np

from sbm_gym.worlds.towns.fixtures import bus_stop, traffic_light
from sbm_gym.worlds.towns.furnisher import Furnisher
from sbm_gym.worlds.towns.kerbs import furnish_kerb, kerb_lines
from sbm_gym.worlds.towns.places import car_park, park, square
from sbm_gym.worlds.towns.plan import TownPlan


def furnish_town(furnisher: Furnisher, plan: TownPlan) -> None:
    """Adds everything that stands on pavements, squares and lawns."""
    rng = furnisher.rng
    for block in plan.blocks:
        if block.kind == "park":
            park(furnisher, block)
        elif block.kind == "square":
            square(furnisher, block)
        elif block.kind == "car_park":
            car_park(furnisher, block)
    for spawn in plan.spawns:
        if spawn.kind == "bus":
            bus_stop(furnisher, spawn)
    _junctions(furnisher, plan)
    lamps = furnisher.library.models("street_light")
    lamp = lamps[int(rng.integers(len(lamps)))] if lamps else None
    species = furnisher.library.models("street_tree")
    trees = [species[int(k)] for k in rng.permutation(len(species))[:2]]
    lines = kerb_lines(plan)
    for index in rng.permutation(len(lines)):
        furnish_kerb(furnisher, lines[index], lamp, trees)


def _junctions(furnisher: Furnisher, plan: TownPlan) -> None:
    """Traffic lights where traffic waits, and signs at zebra crossings."""
    for segment in plan.segments:
        street = segment.street
        for is_end in (False, True):
            if not segment.stops[int(is_end)]:
                continue
            edge = segment.end_m - 4.7 if is_end else segment.start_m + 4.7
            side = street.right_side(is_end)
            kerb = street.half_m[0] if side > 0 else street.half_m[1]
            xy = street.point(edge, side * (kerb + 0.5))
            heading = street.heading_rad(is_end)
            traffic_light(furnisher, xy, np.array([np.cos(heading), np.sin(heading)]))
