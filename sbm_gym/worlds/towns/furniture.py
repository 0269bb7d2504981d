"""Furnishes a town: parks and squares, bus stops, junctions, and kerbs with lamps and trees in turn."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from sbm_gym.assets.catalog.library import ModelCard
from sbm_gym.worlds.towns import materials
from sbm_gym.worlds.towns.fixtures import bus_stop, hydrant, post_box, sign, traffic_light
from sbm_gym.worlds.towns.furnisher import Furnisher, stem_rectangle
from sbm_gym.worlds.towns.ground import flat
from sbm_gym.worlds.towns.places import car_park, park, square
from sbm_gym.worlds.towns.plan import CORNER_M, KERB_M, Block, Rect, TownPlan

PLACES = {"park": park, "square": square, "car_park": car_park}
"""What furnishes the blocks that are not built over."""


def furnish_town(furnisher: Furnisher, plan: TownPlan) -> None:
    """Adds everything that stands on pavements, squares and lawns."""
    rng = furnisher.rng
    for block in plan.blocks:
        if block.kind in PLACES:
            PLACES[block.kind](furnisher, block)
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
    """Traffic lights where traffic waits."""
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


@dataclass(frozen=True)
class KerbLine:
    """A straight kerb; the pavement is on the left of its direction."""

    start_m: Float[np.ndarray, "2"]
    along: Float[np.ndarray, "2"]
    length_m: float
    block: Block | None
    """The block it belongs to, None beyond the ring."""

    @property
    def left(self) -> Float[np.ndarray, "2"]:
        """From the road to the houses."""
        return np.array([-self.along[1], self.along[0]])

    def at(self, along_m: float, in_m: float) -> Float[np.ndarray, "2"]:
        """A point on the pavement."""
        return self.start_m + along_m * self.along + in_m * self.left

    def yaw_rad(self, to_road: bool = True) -> float:
        """Yaw of a model whose front looks to the road (or away from it)."""
        front = -self.left if to_road else self.left
        return float(np.arctan2(front[0], -front[1]))


def kerb_lines(plan: TownPlan) -> list[KerbLine]:
    """All kerbs: around the blocks, and around the ring."""
    lines = []
    road = plan.carriageway
    ring = [(road.x0, road.y0), (road.x0, road.y1), (road.x1, road.y1), (road.x1, road.y0)]
    outlines: list[tuple[list, Block | None]] = [(ring, None)]
    for corners, block in outlines + [(block.rect.corners, block) for block in plan.blocks]:
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            start, end = np.array(a, float), np.array(b, float)
            length = float(np.linalg.norm(end - start))
            lines.append(KerbLine(start, (end - start) / length, length, block))
    return lines


def furnish_kerb(furnisher: Furnisher, line: KerbLine, lamp: ModelCard | None, trees: list[ModelCard]) -> None:
    """Lamps and trees in turn, and between them bins, benches, hydrants, signs."""
    rng = furnisher.rng
    places = np.arange(CORNER_M + 4.5, line.length_m - CORNER_M - 4.0, 6.5)
    with_trees = bool(trees) and rng.random() < 0.75
    tree = trees[int(rng.integers(len(trees)))] if trees else None
    for k, place in enumerate(places):
        at = float(place + rng.uniform(-0.3, 0.3))
        if k % 3 == 1 and lamp is not None:
            # A lamp leans over the road; its stem stands at its back.
            stem = stem_rectangle(furnisher.library.load(lamp))
            offset = 0.5 * (stem[1] + stem[3])
            furnisher.stand(lamp, line.at(at, 0.55 - offset), line.yaw_rad())
        elif with_trees and k % 3 == 2:
            _tree_pit(furnisher, tree, line.at(at, 0.95))
        between = float(place + 3.2)
        if between > line.length_m - CORNER_M - 3:
            continue
        drawn = rng.random()
        if drawn < 0.10:
            furnisher.stand(furnisher.town_own("litter_bin"), line.at(between, 0.7), 0.0)
        elif drawn < 0.28:
            furnisher.stand(furnisher.town_own("bench"), line.at(between, 0.75), line.yaw_rad(to_road=False))
        elif drawn < 0.36:
            hydrant(furnisher, line.at(between, 0.5), -line.left)
        elif drawn < 0.48:
            sign(furnisher, line.at(between, 0.45), line.along, str(rng.choice(["limit", "parking", "no_entry"])))
        elif drawn < 0.54:
            post_box(furnisher, line.at(between, 0.6))


def _tree_pit(furnisher: Furnisher, tree: ModelCard | None, xy: Float[np.ndarray, "2"]) -> None:
    """A tree in a square of soil."""
    if tree is None or not furnisher.tree(tree, xy):
        return
    pit = Rect(xy[0] - 0.65, xy[1] - 0.65, xy[0] + 0.65, xy[1] + 0.65)
    furnisher.meshes.tiled(flat(pit, KERB_M + 0.012), materials.material("gravel"), (0.55, 0.45, 0.38, 1.0))
