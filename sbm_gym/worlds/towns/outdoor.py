"""Towns: from a name or a seed to a world of streets, with two more vehicles in every episode.

What belongs to a town for ever: its plan, houses, trees, and the vehicles that are parked or wait there. What an
episode adds: two vehicles, of a few that are moved about, at free places where vehicles naturally stand (thesis
A.2.2), and the weather. All vehicles are objects: a label of a parked car is as right as one of these two.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from labeling.core.errors import MissingAssetsError, UsageError
from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.scene_models import models_of_scene, town_library
from sbm_gym.worlds.geometry.navigable import NavigableMap, navigable_map
from sbm_gym.worlds.geometry.placing import Box, Placement, obstacle_rows, overlap, yaw_quaternion
from sbm_gym.worlds.moving.motion_config import MotionConfig
from sbm_gym.worlds.moving.movers import Mover
from sbm_gym.worlds.moving.route import Route
from sbm_gym.worlds.scene_builder import SceneBuilder, instance_of
from sbm_gym.worlds.splits import TOWNS
from sbm_gym.worlds.static_meshes import StaticMeshes
from sbm_gym.worlds.towns.furnisher import Furnisher
from sbm_gym.worlds.towns.furniture import furnish_town
from sbm_gym.worlds.towns.ground import build_ground
from sbm_gym.worlds.towns.houses import build_houses, house_rows
from sbm_gym.worlds.towns.lanes import AHEAD_M, SPEED_M_S, WHEELBASE_SHARE, Lane, drive, lanes_of
from sbm_gym.worlds.towns.plan import Spawn, TownPlan, draw_plan
from sbm_gym.worlds.towns.vehicles import VEHICLE_USES, add_vehicle, fits, park
from sbm_gym.worlds.towns.weather import Weather, draw_weather
from sbm_gym.worlds.world import Arrangement, ObjectInstance, World

CELL_M = 0.2
"""Of the navigable map."""
RING_M = (3.0, 15.0)
"""Distances from which a vehicle is looked at. Source: thesis A.2.2."""
NEARBY_M = 24.0
"""An episode takes place within this distance (along x and y) of its first vehicle."""
START_CLEARANCE_M, START_DEPTH_M = 2.0, 7.0
"""Episodes start this far from the end of the first vehicle, and up to this much farther."""
MIN_BEARINGS = 8
"""A place from around which fewer of ``BEARINGS`` directions can be looked from is left empty."""
MIN_APART_M = 3.0
"""Between the two vehicles of an episode. Source: thesis A.2.2."""
MAX_PARKED = 16
"""Vehicles that belong to a town."""
MOVED_VEHICLES = {"car": 4, "van": 1, "truck": 1, "bus": 1, "motorcycle": 2, "bicycle": 1}
"""Of which an episode shows two; roads have about these shares."""
DRIVEN = ("car", "van", "truck", "motorcycle", "bicycle")
"""Uses of vehicles that drive where streets are in motion."""
MAX_DRIVEN_M = 10.0
"""Longer vehicles stay where they are: they are longer than junctions are wide."""
HEAVY_TRIANGLES = 16_000
"""Of models with more triangles a town has one at most."""
MOVED_TRIANGLES = 6_000
"""Moved vehicles have no more triangles than this where there is a choice: to move them between episodes costs time."""
_UNDERGROUND_M = -60.0


def build_outdoor(scene: str | int, *, library: FurnitureLibrary | None = None, unseen_models: bool = False) -> World:
    """Builds a town.

    The same scene gives the same world in any process, given the same libraries.

    Args:
        scene: a named town (``town/train/00``), ``town/seed/N`` or N.
        library: where vehicles, trees and street furniture come from; the installed catalogues with some builtin
            street furniture if None.
        unseen_models: keep the vehicle models that validation and test towns show out of every other town but final
            ones, which show no others. Validation and test towns are the same either way.

    Returns:
        The world, without an agent. Its ``stage`` places the vehicles of an episode.

    Raises:
        UsageError: if there is no such town.
        MissingAssetsError: if there are no models of vehicles.
    """
    name, source = TOWNS.resolve(scene)
    held_out = TOWNS.shows_held_out(name, unseen_models)
    library = models_of_scene(library or town_library(), held_out, unseen_models)
    rng = np.random.default_rng(source.seed)
    plan = draw_plan(rng)
    spec = mujoco.MjSpec()
    spec.modelname = name.replace("/", "_")
    spec.visual.map.znear, spec.visual.map.zfar = 0.002, 12.0
    spec.stat.extent, spec.stat.center = 40.0, [0.0, 0.0, 2.0]
    draw_weather(rng).add_to(spec)
    builder = SceneBuilder(spec)
    meshes = StaticMeshes(builder, spec.worldbody.add_body(name="town"))
    build_ground(meshes, plan, rng)
    houses = house_rows(plan, rng)
    build_houses(meshes, houses, rng)
    for number, house in enumerate(houses):
        r, body = house.rect, spec.worldbody.add_body(name=f"house_{number}")
        builder.touched_box(body, np.array([r.x0, r.y0, r.x1, r.y1]), (0.0, house.eaves_m))
    reserved, solid = [spawn.area() for spawn in plan.spawns], [house.rect.box for house in houses]
    furnisher = Furnisher(builder, meshes, library, rng, reserved, solid)
    furnish_town(furnisher, plan)
    meshes.build()
    walkable = plan.walkable
    low, high = np.array([walkable.x0, walkable.y0]), np.array([walkable.x1, walkable.y1])
    still = navigable_map(low, high, obstacle_rows(furnisher.obstacles), cell_m=CELL_M)
    areas = {spawn: spawn.area() for spawn in plan.spawns}
    blocked = {s for s, area in areas.items() if any(overlap(area, solid, 0.05) for solid in furnisher.obstacles)}
    spawns = [spawn for spawn in plan.spawns if spawn not in blocked]
    parked, taken = _park_vehicles(plan, spawns, still, library, rng)
    objects: list[ObjectInstance] = []
    for number, vehicle in enumerate(parked, start=1):
        body = add_vehicle(builder, library, vehicle, f"{vehicle.card.category}_{number:02d}", rng)
        objects.append(instance_of(vehicle, number, body.name))
    navigable = _with_vehicles(still.free, low, [(one, library.load(one.card).footprint_m) for one in parked])
    moved = _add_moved_vehicles(builder, library, len(objects) + 1, rng)
    left = tuple(spawn for spawn in spawns if spawn not in taken)
    lanes = lanes_of(plan.segments)
    stage = TownStage(navigable, left, moved, tuple(objects), tuple(vehicle.box for vehicle in parked), lanes)
    return World(name, spec, tuple(objects), navigable, stage=stage, left_out=builder.left_out)


def _park_vehicles(
    plan: TownPlan, spawns: list[Spawn], still: NavigableMap, library: FurnitureLibrary, rng: np.random.Generator
) -> tuple[list[Placement], set[Spawn]]:
    """The vehicles that belong to a town: some parked, some waiting, at most about a third of all places taken."""
    cards = {use: library.models(use) for use in VEHICLE_USES}
    if not any(cards.values()):
        raise MissingAssetsError(
            "the furniture libraries hold no vehicles: run `sudo apt-get install sweethome3d-furniture`"
        )
    heavy: set[str] = set()
    parked: list[Placement] = []
    taken: set[Spawn] = set()
    limit = min(MAX_PARKED, max(len(spawns) // 3, 2))
    shares = {"bay": 0.75, "loading": 0.9, "bus": 0.9, "lane": 0.45, "rack": 0.45}
    for index in rng.permutation(len(spawns)):
        spawn = spawns[index]
        if len(parked) >= limit:
            break
        choices = [
            card
            for use in VEHICLE_USES
            for card in cards[use]
            if fits(card, spawn) and not (heavy and library.triangles(card) > HEAVY_TRIANGLES)
        ]
        # Nobody parks a motorcycle where a car fits as often as a car.
        weights = np.array([MOVED_VEHICLES[card.use] / len(cards[card.use]) for card in choices])
        if not choices or rng.random() > shares[spawn.kind]:
            continue
        vehicle = park(choices[int(rng.choice(len(choices), p=weights / weights.sum()))], spawn, rng)
        if any(overlap(vehicle.box, other.box, 0.25) for other in parked):
            continue
        if approach_bearings(still, spawn.middle_m) < MIN_BEARINGS:
            continue
        if library.triangles(vehicle.card) > HEAVY_TRIANGLES:
            heavy.add(vehicle.card.model_id)
        parked.append(vehicle)
        taken.add(spawn)
    return parked, taken


def approach_bearings(navigable: NavigableMap, centre_m: Float[np.ndarray, "2"]) -> int:
    """From how many of ``BEARINGS`` directions a vehicle can be looked at from 3 to 15 m away."""
    free = navigable.free_around(centre_m, np.arange(*RING_M, 0.5))
    return int(np.count_nonzero(free.any(axis=1)))


@dataclass(frozen=True)
class MovedVehicle:
    """A vehicle that episodes put somewhere; elsewhile it waits below the ground."""

    card: ModelCard
    body_name: str
    instance_id: int
    footprint_m: Float[np.ndarray, "boxes 4"]
    """See ``FurnitureModel``."""


_Placed = tuple[MovedVehicle, Placement]


def _add_moved_vehicles(
    builder: SceneBuilder, library: FurnitureLibrary, first_id: int, rng: np.random.Generator
) -> tuple[MovedVehicle, ...]:
    moved: list[MovedVehicle] = []
    for use, count in MOVED_VEHICLES.items():
        cards = sorted(library.models(use), key=library.triangles)
        cards = [card for card in cards if library.triangles(card) <= MOVED_TRIANGLES] or cards[:1]
        for k in rng.permutation(len(cards))[:count]:
            number = len(moved)
            card = cards[int(k)]
            below = Placement(card, 0.0, 0.0, 0.0, _UNDERGROUND_M - 10.0 * number)
            body = add_vehicle(builder, library, below, f"visitor_{number}", rng, moves=True)
            moved.append(MovedVehicle(card, body.name, first_id + number, library.load(card).footprint_m))
    return tuple(moved)


@dataclass(frozen=True)
class TownStage:
    """Places two vehicles for an episode and draws its weather. Implements ``Stage``."""

    navigable: NavigableMap
    spawns: tuple[Spawn, ...]
    """Places that the town's own vehicles leave free."""
    moved: tuple[MovedVehicle, ...]
    objects: tuple[ObjectInstance, ...]
    parked: tuple[Box, ...]
    lanes: tuple[Lane, ...]

    def arrange(self, rng: np.random.Generator) -> Arrangement:
        """Draws the two vehicles, where they stand, where the agent may start, and the weather.

        Source: thesis A.2.2: a random natural place, and the nearest other one at least 3 m away.
        """
        while True:
            placed = self._draw(rng)
            if placed is None:
                continue
            navigable = self._around(placed)
            centre = np.array([placed[0][1].x_m, placed[0][1].y_m])
            # Right beside a bus nothing of it can be made out.
            nearest_m = max(RING_M[0], 0.5 * max(placed[0][1].card.size_m[:2]) + START_CLEARANCE_M)
            # Cells whose centres lie on a ring.
            rows, columns = navigable.free.shape
            x = navigable.origin_m[0] + CELL_M * (np.arange(columns) + 0.5) - centre[0]
            y = navigable.origin_m[1] + CELL_M * (np.arange(rows) + 0.5) - centre[1]
            away = np.hypot(x[None], y[:, None])
            ring = (away >= nearest_m) & (away <= min(nearest_m + START_DEPTH_M, RING_M[1]))
            starts = NavigableMap(navigable.free & ring, navigable.origin_m, CELL_M)
            reached = min(approach_bearings(navigable, np.array([s.x_m, s.y_m])) for _, s in placed)
            if starts.free.any() and reached >= MIN_BEARINGS:
                break
        weather = draw_weather(rng)
        instances = tuple(instance_of(vehicle, v.instance_id, v.body_name) for v, vehicle in placed)
        change = functools.partial(self._change, placed, weather)
        return Arrangement(self.objects + instances, navigable, starts, change)

    def set_in_motion(
        self, arrangement: Arrangement, rng: np.random.Generator, motion: MotionConfig, seconds: float
    ) -> Arrangement:
        """Sends vehicles that the episode does not place on their ways; fewer where lanes are blocked. Implements
        ``MovingStage``.

        Raises:
            UsageError: if ``motion.shifted`` is asked for.
        """
        if motion.shifted:
            raise UsageError("shifted goes with rooms: in towns every episode places its two vehicles anew as it is")
        *_, first, second = arrangement.objects
        free = _with_vehicles(
            self.navigable.free, self.navigable.origin_m, [self._standing(one) for one in (first, second)]
        )
        gone = {first.instance_id, second.instance_id}
        waiting = [
            one
            for one in self.moved
            if one.card.use in DRIVEN and one.card.size_m[1] <= MAX_DRIVEN_M and one.instance_id not in gone
        ]
        movers: list[Mover] = []
        objects, starts = [], arrangement.starts
        for k in rng.permutation(len(waiting)):
            if len(movers) == motion.moving:
                break
            one = waiting[int(k)]
            vehicle = Mover(
                instance_id=one.instance_id,
                body_name=one.body_name,
                size_m=one.card.size_m,
                route=Route(np.zeros((1, 2))),
                speed_m_s=float(rng.uniform(*SPEED_M_S)),
                wheelbase_m=WHEELBASE_SHARE * one.card.size_m[1],
                ahead_m=AHEAD_M,
            )
            taken = [mover.box(0.0) for mover in movers]
            sent = drive(self.lanes, free, taken, first.box_3d.centre_m[:2], vehicle, seconds, rng)
            if sent is None:
                continue
            left = starts.without(obstacle_rows([sent.box(0.0)]), START_CLEARANCE_M)
            if left.free.any():
                x, y, yaw = sent.pose(0.0)
                objects.append(instance_of(Placement(one.card, x, y, yaw), one.instance_id, one.body_name))
                movers.append(replace(sent, speed_m_s=motion.speed * sent.speed_m_s))
                starts = left
        return replace(arrangement, starts=starts).with_movers(movers, objects)

    def _standing(self, vehicle: ObjectInstance) -> tuple[Placement, Float[np.ndarray, "boxes 4"]]:
        """One of the vehicles that the episode has placed, and its footprint."""
        one = next(one for one in self.moved if one.instance_id == vehicle.instance_id)
        (x, y), turn = vehicle.box_3d.centre_m[:2].tolist(), vehicle.box_3d.rotation
        return Placement(one.card, x, y, float(np.arctan2(turn[1, 0], turn[0, 0]))), one.footprint_m

    def _change(self, placed: tuple[_Placed, _Placed], weather: Weather, model: mujoco.MjModel) -> None:
        """Brings the vehicles of an episode to their places, the others below the ground, and changes the weather."""
        for number, one in enumerate(self.moved):
            model.body_pos[model.body(one.body_name).id] = [0.0, 0.0, _UNDERGROUND_M - 10.0 * number]
        for one, vehicle in placed:
            body = model.body(one.body_name).id
            model.body_pos[body] = [vehicle.x_m, vehicle.y_m, vehicle.z_m]
            model.body_quat[body] = yaw_quaternion(vehicle.yaw_rad)
        weather.apply(model)

    def _draw(self, rng: np.random.Generator) -> tuple[_Placed, _Placed] | None:
        first = self._place(self.spawns[int(rng.integers(len(self.spawns)))], (), rng)
        if first is None:
            return None
        at = np.array([first[1].x_m, first[1].y_m])
        others = [(float(np.hypot(s.x_m - at[0], s.y_m - at[1])), k) for k, s in enumerate(self.spawns)]
        for distance_m, k in sorted(others):
            second = self._place(self.spawns[k], (first,), rng) if distance_m >= MIN_APART_M else None
            if second is not None:
                apart = np.hypot(second[1].x_m - at[0], second[1].y_m - at[1])
                return (first, second) if apart >= MIN_APART_M else None
        return None

    def _place(self, spawn: Spawn, others: tuple, rng: np.random.Generator) -> _Placed | None:
        """One of the vehicles that fit a place and are not placed yet; None if none does."""
        gone = {one.instance_id for one, _ in others}
        choices = [v for v in self.moved if v.instance_id not in gone and fits(v.card, spawn)]
        if not choices:
            return None
        one = choices[int(rng.integers(len(choices)))]
        vehicle = park(one.card, spawn, rng)
        boxes = (*self.parked, *(other.box for _, other in others))
        return None if any(overlap(vehicle.box, box, 0.2) for box in boxes) else (one, vehicle)

    def _around(self, placed: Sequence[_Placed]) -> NavigableMap:
        """The part of the map around the first vehicle, with both in it."""
        centre = np.array([placed[0][1].x_m, placed[0][1].y_m])
        whole = self.navigable
        low = np.floor((centre - NEARBY_M - whole.origin_m) / CELL_M).astype(int)
        high = np.ceil((centre + NEARBY_M - whole.origin_m) / CELL_M).astype(int)
        low = np.maximum(low, 0)
        free = whole.free[low[1] : max(high[1], 1), low[0] : max(high[0], 1)]
        vehicles = [(vehicle, one.footprint_m) for one, vehicle in placed]
        return _with_vehicles(free, whole.origin_m + CELL_M * low, vehicles)


def _with_vehicles(
    free: Bool[np.ndarray, "ny nx"],
    origin_m: Float[np.ndarray, "2"],
    vehicles: Sequence[tuple[Placement, Float[np.ndarray, "boxes 4"]]],
) -> NavigableMap:
    """The connected part of a map that is left when vehicles, of which the footprints are known, stand on it."""
    rows = obstacle_rows(box for one, footprint_m in vehicles for box in one.footprint(footprint_m))
    # A rim of two cells keeps the walls that a map has at its edges away from the cells that count.
    rim = 2 * CELL_M
    size_m = CELL_M * np.array(free.shape[::-1])
    around = navigable_map(origin_m - rim, origin_m + size_m + rim, rows, cell_m=CELL_M).free[2:-2, 2:-2]
    return NavigableMap(free & around, origin_m, CELL_M).connected()
