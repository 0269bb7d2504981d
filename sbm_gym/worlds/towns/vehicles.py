"""Vehicles: which one fits where it could stand, painted one by one, as bodies of a world."""

import tomllib
from pathlib import Path

import mujoco
import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.models.classes import VEHICLE_PAINT
from sbm_gym.worlds.geometry.placing import Placement
from sbm_gym.worlds.scene_builder import SceneBuilder
from sbm_gym.worlds.towns.plan import Spawn

VEHICLE_USES = ("car", "van", "truck", "bus", "motorcycle", "bicycle")
_TABLES = tomllib.loads(Path(__file__).with_name("vehicles.toml").read_text(encoding="utf-8"))
FITTING: dict[str, list[str]] = _TABLES["fitting"]
"""What stands where."""


def fits(card: ModelCard, spawn: Spawn) -> bool:
    """Whether a vehicle would stand in a place, and is of a kind that does."""
    width, length, _ = card.size_m
    slack = 0.8 if spawn.kind == "bus" else 0.15  # buses stand half in the lane, as they do
    return card.use in FITTING[spawn.kind] and length <= spawn.length_m and width <= spawn.width_m + slack


def park(card: ModelCard, spawn: Spawn, rng: np.random.Generator) -> Placement:
    """Stands a vehicle in a place, not quite straight; in a bay wider than the vehicle, its kerb side near the kerb."""
    width, length, _ = card.size_m
    spare = max(spawn.length_m - length, 0.0) / 2
    ahead = float(rng.uniform(-0.5, 0.5)) * spare
    right = 0.0
    if spawn.kind in ("bay", "loading") and card.use == "motorcycle":
        right = float(rng.uniform(-0.3, 0.3))
    if width > spawn.width_m:
        right = -(width - spawn.width_m) / 2 - 0.1
    heading = spawn.ahead
    x, y = spawn.middle_m + ahead * heading + right * np.array([heading[1], -heading[0]])
    turned = float(np.clip(rng.normal(0.0, 0.015), -0.03, 0.03))
    return Placement(card, float(x), float(y), spawn.yaw_rad + turned, spawn.z_m)


def add_vehicle(
    builder: SceneBuilder,
    library: FurnitureLibrary,
    vehicle: Placement,
    name: str,
    rng: np.random.Generator,
    *,
    moves: bool = False,
) -> mujoco.MjsBody:
    """Adds a vehicle with a colour of its own, drawn and touched.

    Args:
        builder: the world.
        library: where its model comes from.
        vehicle: what and where.
        name: of its body.
        rng: draws the colour.
        moves: whether episodes put it elsewhere (a mocap body).
    """
    model = library.load(vehicle.card)
    body = builder.place(name, vehicle, moves=moves)
    paint = VEHICLE_PAINT.get(vehicle.card.model_id)
    paints = _TABLES["paints"]
    colour = paints[int(rng.choice(len(paints), p=[each["share"] for each in paints]))]["rgb"]
    builder.furniture(body, model, None if paint is None else {paint: (*colour, 1.0)})
    for rectangle in model.footprint_m:
        builder.touched_box(body, rectangle, (0.0, vehicle.card.size_m[2]))
    return body
