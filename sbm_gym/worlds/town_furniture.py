"""What stands in streets besides houses and vehicles: trees, lamps, signs, lights, benches, shelters, parks."""

import functools
from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.assets.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.model import FurnitureModel
from sbm_gym.worlds import town_materials as materials
from sbm_gym.worlds.building import SceneBuilder
from sbm_gym.worlds.foliage import thin_foliage
from sbm_gym.worlds.placing import Box, overlap, rotation
from sbm_gym.worlds.soup import Facade, QuadSoup, box_quads
from sbm_gym.worlds.town_ground import flat
from sbm_gym.worlds.town_plan import CAR_PARK_M, CORNER_M, KERB_M, PAVEMENT_M, Block, Rect, Spawn, TownPlan

THINNED = {"street_tree": 8_000, "park_tree": 8_000}
"""Uses whose models are thinned, and to how many triangles."""
CLEAR_M = 2.3
"""Street trees are pruned up to this height."""
MAX_TREES = 10
"""A crown is as heavy as three cars."""
MOST = {"litter_bin": 3, "fountain": 2, "cafe_table": 5, "cafe_chair": 8}
"""Uses whose models are heavy for their size, and how many of them a town has at most."""
STEM_HEIGHT_M = 1.3
"""What a tree or lamp has below this height is in the agent's way."""
MAX_STEM_M = 0.45
_STEEL = (0.30, 0.31, 0.33, 1.0)
_DARK = (0.10, 0.11, 0.12, 1.0)


@dataclass
class Furnisher:
    """Puts things into a town and keeps account of the floor they take."""

    builder: SceneBuilder
    soup: QuadSoup
    library: FurnitureLibrary
    rng: np.random.Generator
    reserved: list[Box]
    """Floor that must stay empty: where vehicles stand."""
    obstacles: list[Box] = field(default_factory=list)
    """What the agent has to walk around."""
    _counts: dict[str, int] = field(default_factory=dict)
    """Things of each use."""
    _trees: int = 0

    def fits(self, box: Box, margin_m: float = 0.05) -> bool:
        """Whether nothing stands there yet."""
        return not any(overlap(box, other, margin_m) for other in (*self.reserved, *self.obstacles))

    def block(self, box: Box, height_m: float = 2.0) -> None:
        """Makes the agent walk around a box."""
        self.obstacles.append(box)
        turn = [np.cos(box.yaw_rad / 2), 0.0, 0.0, np.sin(box.yaw_rad / 2)]
        body = self.builder.spec.worldbody.add_body(
            name=f"solid_{len(self.obstacles)}", pos=[box.x_m, box.y_m, 0.0], quat=turn
        )
        half = np.array([box.half_x_m, box.half_y_m])
        self.builder.touched_box(body, np.concatenate([-half, half]), (0.0, height_m))

    def pick(self, use: str) -> ModelCard | None:
        """A random model for a use, None if the library has none."""
        cards = self.library.models(use)
        return cards[int(self.rng.integers(len(cards)))] if cards else None

    def stand(self, card: ModelCard | None, xy: Float[np.ndarray, "2"], yaw_rad: float, z_m: float = KERB_M) -> bool:
        """Stands a thing of the library on the ground, unless something is in the way."""
        number = 0 if card is None else self._counts.get(card.use, 0)
        if card is None or number >= MOST.get(card.use, number + 1):
            return False
        model = self.library.load(card)
        rectangle = np.array([*(-0.5 * np.array(model.size_m[:2])), *(0.5 * np.array(model.size_m[:2]))])
        if card.use in THINNED:
            model = _thinned(model, THINNED[card.use])
        if model.size_m[2] > 2.2:
            rectangle = _stem(model)
        centre = xy + rotation(yaw_rad) @ (0.5 * (rectangle[:2] + rectangle[2:]))
        half = 0.5 * (rectangle[2:] - rectangle[:2])
        box = Box(float(centre[0]), float(centre[1]), float(half[0]), float(half[1]), yaw_rad)
        if not self.fits(box):
            return False
        self._counts[card.use] = number + 1
        body = self.builder.spec.worldbody.add_body(
            name=f"{card.use}_{number}",
            pos=[float(xy[0]), float(xy[1]), z_m],
            quat=[np.cos(yaw_rad / 2), 0.0, 0.0, np.sin(yaw_rad / 2)],
        )
        self.builder.furniture(body, model)
        self.block(box, max(min(model.size_m[2], 2.2), 0.3) + z_m)
        return True

    def tree(self, card: ModelCard | None, xy: Float[np.ndarray, "2"]) -> bool:
        """Plants a tree, unless the town has enough of them."""
        if self._trees >= MAX_TREES or not self.stand(card, xy, float(self.rng.uniform(-np.pi, np.pi))):
            return False
        self._trees += 1
        return True

    def post(
        self, xy: Float[np.ndarray, "2"], radius_m: float, height_m: float, rgba=_STEEL, z_m: float = KERB_M
    ) -> bool:
        """An upright round post, unless something is in the way."""
        box = Box(float(xy[0]), float(xy[1]), radius_m, radius_m, 0.0)
        if not self.fits(box):
            return False
        self.soup.plain(prism(xy, radius_m, z_m, z_m + height_m), rgba, specular=0.2)
        self.block(box)
        return True


MAX_REMEMBERED = 32
"""Thinned models kept; libraries that make models from seeds never run out of them."""
_THINNED: dict[int, tuple[FurnitureModel, FurnitureModel]] = {}
"""Plants of this process by id, as they were (which keeps their ids their own) and thinned."""


def _thinned(model: FurnitureModel, max_triangles: int) -> FurnitureModel:
    """The thinned model, made once for each model of a process."""
    if id(model) not in _THINNED:
        while len(_THINNED) >= MAX_REMEMBERED:
            del _THINNED[next(iter(_THINNED))]
        _THINNED[id(model)] = (model, thin_foliage(model, max_triangles, CLEAR_M))
    return _THINNED[id(model)][1]


def _stem(model: FurnitureModel) -> Float[np.ndarray, "4"]:
    """Rectangle (min x, min y, max x, max y) around what a tall model has near the ground."""
    points = np.concatenate([surface.vertices_m for surface in model.surfaces])
    low = points[points[:, 2] < max(STEM_HEIGHT_M, points[:, 2].min() + 0.2), :2]
    middle = np.median(low, axis=0)
    reach = np.clip(np.quantile(np.abs(low - middle), 0.95, axis=0), 0.08, MAX_STEM_M)
    return np.concatenate([middle - reach, middle + reach])


def prism(
    xy: Float[np.ndarray, "2"], radius_m: float, low_m: float, high_m: float, sides: int = 8
) -> Float[np.ndarray, "q 4 3"]:
    """Sides and top of an upright prism."""
    angles = 2 * np.pi * np.arange(sides) / sides
    a = np.asarray(xy) + radius_m * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    b = np.roll(a, -1, axis=0)
    low, high = np.full((sides, 1), low_m), np.full((sides, 1), high_m)
    walls = np.stack([np.hstack(v) for v in ((a, low), (b, low), (b, high), (a, high))], axis=1)
    centre = np.broadcast_to(np.append(xy, high_m), (sides, 3))
    top = np.stack([centre, np.hstack((a, high)), np.hstack((b, high)), np.hstack((b, high))], axis=1)
    return np.concatenate([walls, top])


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
    for block in plan.blocks:
        r = block.rect
        outlines.append(([(r.x0, r.y0), (r.x1, r.y0), (r.x1, r.y1), (r.x0, r.y1)], block))
    for corners, block in outlines:
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
            start, end = np.array(a, float), np.array(b, float)
            length = float(np.linalg.norm(end - start))
            lines.append(KerbLine(start, (end - start) / length, length, block))
    return lines


def furnish_town(furnisher: Furnisher, plan: TownPlan) -> None:
    """Adds everything that stands on pavements, squares and lawns."""
    rng = furnisher.rng
    for block in plan.blocks:
        if block.kind == "park":
            _park(furnisher, block)
        elif block.kind == "square":
            _square(furnisher, block)
        elif block.kind == "car_park":
            _car_park(furnisher, block)
    for spawn in plan.spawns:
        if spawn.kind == "bus":
            _bus_stop(furnisher, spawn)
    _junctions(furnisher, plan)
    lamps = furnisher.library.models("street_light")
    lamp = lamps[int(rng.integers(len(lamps)))] if lamps else None
    species = furnisher.library.models("street_tree")
    trees = [species[int(k)] for k in rng.permutation(len(species))[:2]]
    lines = kerb_lines(plan)
    for index in rng.permutation(len(lines)):
        _along_kerb(furnisher, lines[index], lamp, trees)


def _along_kerb(furnisher: Furnisher, line: KerbLine, lamp: ModelCard | None, trees: list[ModelCard]) -> None:
    """Lamps and trees in turn, and between them bins, benches, hydrants, signs."""
    rng = furnisher.rng
    places = np.arange(CORNER_M + 4.5, line.length_m - CORNER_M - 4.0, 6.5)
    with_trees = bool(trees) and rng.random() < 0.75
    tree = trees[int(rng.integers(len(trees)))] if trees else None
    for k, place in enumerate(places):
        at = float(place + rng.uniform(-0.3, 0.3))
        if k % 3 == 1 and lamp is not None:
            # A lamp leans over the road; its stem stands at its back.
            stem = _stem(furnisher.library.load(lamp))
            offset = 0.5 * (stem[1] + stem[3])
            furnisher.stand(lamp, line.at(at, 0.55 - offset), line.yaw_rad())
        elif with_trees and k % 3 == 2:
            _tree_pit(furnisher, tree, line.at(at, 0.95))
        between = float(place + 3.2)
        if between > line.length_m - CORNER_M - 3:
            continue
        drawn = rng.random()
        if drawn < 0.10:
            furnisher.stand(furnisher.pick("litter_bin"), line.at(between, 0.7), 0.0)
        elif drawn < 0.28:
            furnisher.stand(furnisher.pick("bench"), line.at(between, 0.75), line.yaw_rad(to_road=False))
        elif drawn < 0.36:
            _hydrant(furnisher, line.at(between, 0.5), -line.left)
        elif drawn < 0.48:
            _sign(furnisher, line.at(between, 0.45), line, str(rng.choice(["limit", "parking", "no_entry"])))
        elif drawn < 0.54:
            _post_box(furnisher, line.at(between, 0.6))


def _tree_pit(furnisher: Furnisher, tree: ModelCard | None, xy: Float[np.ndarray, "2"]) -> None:
    """A tree in a square of soil."""
    if tree is None or not furnisher.tree(tree, xy):
        return
    pit = Rect(xy[0] - 0.65, xy[1] - 0.65, xy[0] + 0.65, xy[1] + 0.65)
    furnisher.soup.tiled(flat(pit, KERB_M + 0.012), materials.gravel(), (0.55, 0.45, 0.38, 1.0))


def _sign(furnisher: Furnisher, xy: Float[np.ndarray, "2"], line: KerbLine, kind: str) -> None:
    """A road sign that looks against the traffic on its side of the road."""
    # Traffic on the side of this kerb drives with the kerb on its right: against the direction of the line.
    _sign_facing(furnisher, xy, line.along, kind)


def _sign_facing(furnisher: Furnisher, xy: Float[np.ndarray, "2"], front: Float[np.ndarray, "2"], kind: str) -> None:
    if not furnisher.post(xy, 0.035, 2.75):
        return
    right = np.array([-front[1], front[0]])
    picture = materials.road_sign(kind)
    for offset, side, shown in ((0.045, 1.0, picture), (0.040, -1.0, _back_of(kind))):
        facade = Facade(xy + offset * front - side * 0.33 * right, side * right, KERB_M)
        furnisher.soup.pictured(facade.quads(0.0, 0.66, 2.1, 2.76), shown, specular=0.1)


@functools.cache
def _back_of(kind: str) -> np.ndarray:
    """The bare metal of a sign's back."""
    picture = materials.road_sign(kind)[:, ::-1].copy()
    picture[..., :3] = (150, 152, 154)
    return picture


def _post_box(furnisher: Furnisher, xy: Float[np.ndarray, "2"]) -> None:
    if furnisher.post(xy, 0.24, 1.25, (0.70, 0.07, 0.08, 1.0)):
        furnisher.soup.plain(prism(xy, 0.28, KERB_M + 1.25, KERB_M + 1.38), (0.62, 0.05, 0.06, 1.0), specular=0.3)
        furnisher.soup.plain(prism(xy, 0.26, KERB_M, KERB_M + 0.18), _DARK)


def _hydrant(furnisher: Furnisher, xy: Float[np.ndarray, "2"], front: Float[np.ndarray, "2"]) -> None:
    """A red fire hydrant. The library's has 31 000 triangles, more than ten cars."""
    red = (0.72, 0.06, 0.05, 1.0)
    if not furnisher.post(xy, 0.13, 0.50, red):
        return
    soup, z = furnisher.soup, KERB_M
    for radius, low, high in (
        (0.19, 0.0, 0.06),
        (0.17, 0.44, 0.5),
        (0.15, 0.5, 0.58),
        (0.10, 0.58, 0.66),
        (0.04, 0.66, 0.74),
    ):
        soup.plain(prism(xy, radius, z + low, z + high, 12), red, specular=0.4)
    right = np.array([-front[1], front[0]])
    for out, reach in ((front, 0.20), (right, 0.19), (-right, 0.19)):
        side = np.array([-out[1], out[0]])
        spout = Facade(xy - 0.07 * side, side, z)
        soup.plain(spout.boxes(0.0, 0.14, 0.0, reach, 0.29, 0.43), (0.62, 0.05, 0.05, 1.0), specular=0.4)


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
            _traffic_light(furnisher, xy, np.array([np.cos(heading), np.sin(heading)]))


def _traffic_light(furnisher: Furnisher, xy: Float[np.ndarray, "2"], heading: Float[np.ndarray, "2"]) -> None:
    """A post with three lamps that look against the traffic, red for the moment."""
    if not furnisher.post(xy, 0.06, 3.3, _DARK):
        return
    right = np.array([heading[1], -heading[0]])
    facade = Facade(xy - 0.15 * heading - 0.16 * right, right, KERB_M)
    lit = int(furnisher.rng.integers(2)) * 2
    furnisher.soup.plain(facade.boxes(0.0, 0.32, -0.22, 0.0, 2.4, 3.35), _DARK)
    furnisher.soup.plain(Facade(xy + 0.08 * heading + 0.16 * right, -right, KERB_M).quads(0.0, 0.32, 2.4, 3.35), _DARK)
    for k, colour in enumerate(((0.95, 0.12, 0.08), (0.95, 0.65, 0.10), (0.10, 0.85, 0.35))):
        glow = 1.0 if k == lit else 0.22
        shown = (glow * colour[0], glow * colour[1], glow * colour[2], 1.0)
        height = 3.2 - 0.31 * k
        angles = 2 * np.pi * np.arange(10) / 10
        rim = facade.points(0.16 + 0.11 * np.cos(angles), 0.012, height + 0.11 * np.sin(angles))
        middle = np.broadcast_to(facade.points(0.16, 0.012, height), rim.shape)
        after = np.roll(rim, -1, axis=0)
        furnisher.soup.plain(np.stack([middle, rim, after, after], axis=1), shown, specular=0.3)


def _bus_stop(furnisher: Furnisher, spawn: Spawn) -> None:
    """A glass shelter with a bench on the pavement beside a bus bay."""
    ahead = np.array([np.cos(spawn.heading_rad), np.sin(spawn.heading_rad)])
    right = np.array([ahead[1], -ahead[0]])
    middle = np.array([spawn.x_m, spawn.y_m]) + right * (spawn.width_m / 2 + 2.2)
    half_length = 1.9
    x, y = (float(v) for v in middle + 0.1 * right)
    back = Box(x, y, half_length, 0.28, spawn.heading_rad)
    if not furnisher.fits(back, 0.2):
        return
    furnisher.block(back)
    # Seen from the road: along it to the right is against the traffic's heading.
    shelter = Facade(middle + half_length * ahead + 0.35 * right, -ahead, KERB_M)
    soup, length = furnisher.soup, 2 * half_length
    posts = np.array([0.0, 0.5, 1.0]) * (length - 0.08)
    soup.plain(shelter.boxes(posts, posts + 0.08, 0.0, 0.08, 0.0, 2.35), _DARK, specular=0.2)
    soup.plain(shelter.boxes(0.0, length, 0.0, 1.5, 2.35, 2.47), _STEEL, specular=0.2)
    soup.plain(shelter.quads(0.08, length - 0.08, 0.3, 2.25, 0.04), (0.75, 0.82, 0.84, 0.25), specular=0.8)
    soup.plain(shelter.boxes(0.5, length - 0.5, 0.15, 0.5, 0.42, 0.48), (0.45, 0.32, 0.20, 1.0))
    soup.pictured(
        shelter.quads(length - 1.3, length - 0.2, 0.5, 2.0, 0.06),
        materials.fascia("BUS", (24, 78, 160), (244, 244, 240)),
    )


def _park(furnisher: Furnisher, block: Block) -> None:
    """Lawns between crossing paths, a fountain, trees, hedges, benches."""
    lawn, rng = block.rect.shrunk(PAVEMENT_M - 0.6), furnisher.rng
    x, y = 0.5 * (lawn.x0 + lawn.x1), 0.5 * (lawn.y0 + lawn.y1)
    furnisher.soup.tiled(flat(lawn, KERB_M + 0.01), materials.grass())
    path = 1.3
    for rect in (Rect(lawn.x0, y - path, lawn.x1, y + path), Rect(x - path, lawn.y0, x + path, lawn.y1)):
        furnisher.soup.tiled(flat(rect, KERB_M + 0.022), materials.gravel())
    furnisher.soup.tiled(flat(Rect(x - 3.2, y - 3.2, x + 3.2, y + 3.2), KERB_M + 0.03), materials.gravel())
    furnisher.stand(furnisher.pick("fountain"), np.array([x, y]), 0.0)
    for angle in (0.25, 0.75, 1.25, 1.75):
        away = 4.3 * np.array([np.cos(np.pi * angle), np.sin(np.pi * angle)])
        furnisher.stand(furnisher.pick("bench"), np.array([x, y]) + away, float(np.arctan2(-away[0], away[1])))
    uses = ("park_tree", "street_tree")
    for _ in range(40):
        point = rng.uniform([lawn.x0 + 1.5, lawn.y0 + 1.5], [lawn.x1 - 1.5, lawn.y1 - 1.5])
        if min(abs(point[0] - x), abs(point[1] - y)) < 2.5 or np.hypot(*(point - [x, y])) < 5.5:
            continue
        near = [o for o in furnisher.obstacles if np.hypot(o.x_m - point[0], o.y_m - point[1]) < 5.0]
        if not near and furnisher._trees < 7:
            furnisher.tree(furnisher.pick(uses[int(rng.random() < 0.6)]), point)
    for edge in (lawn.y0 + 0.4, lawn.y1 - 0.4):
        for x0, x1 in ((lawn.x0 + 0.3, x - 2.0), (x + 2.0, lawn.x1 - 0.3)):
            _hedge(furnisher, Rect(x0, edge - 0.3, x1, edge + 0.3))


def _hedge(furnisher: Furnisher, rect: Rect) -> None:
    """A clipped hedge, a metre high, unless something is in the way."""
    width, depth = rect.size_m
    box = Box(0.5 * (rect.x0 + rect.x1), 0.5 * (rect.y0 + rect.y1), width / 2, depth / 2, 0.0)
    if furnisher.fits(box):
        quads = box_quads(np.array([[rect.x0, rect.y0, KERB_M]]), np.array([[rect.x1, rect.y1, KERB_M + 1.0]]))
        furnisher.soup.tiled(quads, materials.leaves())
        furnisher.block(box, 1.1)


def _square(furnisher: Furnisher, block: Block) -> None:
    """A paved square with a fountain, cafe tables under parasols, trees and benches."""
    ground, rng = block.rect.shrunk(PAVEMENT_M - 1.0), furnisher.rng
    x, y = 0.5 * (ground.x0 + ground.x1), 0.5 * (ground.y0 + ground.y1)
    furnisher.soup.tiled(flat(ground, KERB_M + 0.01), materials.ashlar((170, 166, 158)))
    furnisher.stand(furnisher.pick("fountain"), np.array([x, y]), 0.0)
    for _ in range(4):
        table = rng.uniform([ground.x0 + 3, ground.y0 + 3], [ground.x1 - 3, ground.y1 - 3])
        if np.hypot(*(table - [x, y])) < 4.0:
            continue
        turn = float(rng.uniform(-np.pi, np.pi))
        if not furnisher.stand(furnisher.pick("cafe_table"), table, turn):
            continue
        for side in (0.0, np.pi):
            away = 0.68 * np.array([np.sin(turn + side), -np.cos(turn + side)])
            furnisher.stand(furnisher.pick("cafe_chair"), table + away, turn + side + np.pi)
        shade = furnisher.pick("parasol")
        if shade is not None:
            furnisher.stand(shade, table + np.array([1.4, 1.2]), 0.0)
    for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        point = np.array([x, y]) + np.array(corner) * (0.5 * np.array(ground.size_m) - 2.0)
        furnisher.tree(furnisher.pick("street_tree"), point)
        inward = -np.array(corner, float)
        furnisher.stand(furnisher.pick("bench"), point + 3.2 * inward, float(np.arctan2(inward[0], -inward[1])))


def _car_park(furnisher: Furnisher, block: Block) -> None:
    """Asphalt with two rows of bays, a drive to the street, trees at its corners."""
    yard = block.rect.shrunk(PAVEMENT_M - 0.8)
    furnisher.soup.tiled(flat(yard, CAR_PARK_M), materials.asphalt())
    y = 0.5 * (yard.y0 + yard.y1)
    for x0, x1 in ((block.rect.x0, yard.x0), (yard.x1, block.rect.x1)):
        furnisher.soup.tiled(flat(Rect(x0, y - 2.8, x1, y + 2.8), CAR_PARK_M - 0.004), materials.asphalt())
    for sx, sy in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        point = np.array([0.5 * (yard.x0 + yard.x1), y]) + np.array([sx, sy]) * (0.5 * np.array(yard.size_m) - 1.2)
        furnisher.tree(furnisher.pick("street_tree"), point)
    for edge in (yard.y0 + 0.4, yard.y1 - 0.4):
        _hedge(furnisher, Rect(yard.x0 + 2.5, edge - 0.3, yard.x1 - 2.5, edge + 0.3))


def add_solid(spec: mujoco.MjSpec, builder: SceneBuilder, rect: Rect, height_m: float, name: str) -> Box:
    """Makes the agent walk around an upright block."""
    body = spec.worldbody.add_body(name=name)
    builder.touched_box(body, np.array([rect.x0, rect.y0, rect.x1, rect.y1]), (0.0, height_m))
    width, depth = rect.size_m
    return Box(0.5 * (rect.x0 + rect.x1), 0.5 * (rect.y0 + rect.y1), width / 2, depth / 2, 0.0)
