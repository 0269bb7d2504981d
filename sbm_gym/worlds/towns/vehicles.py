"""Vehicles: which one fits where it could stand, painted one by one, as bodies of a world."""

import mujoco
import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.models.classes import VEHICLE_PAINT
from sbm_gym.worlds.geometry.placing import Placement
from sbm_gym.worlds.scene_builder import SceneBuilder
from sbm_gym.worlds.towns.plan import Spawn

VEHICLE_USES = ("car", "van", "truck", "bus", "motorcycle", "bicycle")
FITTING = {
    "bay": ("car", "van", "motorcycle"),
    "loading": ("van", "truck", "car"),
    "bus": ("bus", "truck"),
    "lane": ("car", "van", "truck", "bus", "motorcycle"),
    "rack": ("bicycle",),
}
"""What stands where."""
_PAINTS = (
    (0.88, 0.88, 0.86),
    (0.70, 0.71, 0.72),
    (0.36, 0.37, 0.39),
    (0.06, 0.06, 0.07),
    (0.08, 0.14, 0.34),
    (0.16, 0.30, 0.56),
    (0.58, 0.06, 0.07),
    (0.36, 0.05, 0.08),
    (0.07, 0.22, 0.15),
    (0.62, 0.54, 0.40),
    (0.85, 0.62, 0.08),
    (0.10, 0.42, 0.46),
)
_PAINT_SHARES = np.array([0.18, 0.17, 0.14, 0.12, 0.08, 0.07, 0.08, 0.03, 0.03, 0.04, 0.03, 0.03])


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
    heading = np.array([np.cos(spawn.heading_rad), np.sin(spawn.heading_rad)])
    x, y = np.array([spawn.x_m, spawn.y_m]) + ahead * heading + right * np.array([heading[1], -heading[0]])
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
    colour = _PAINTS[int(rng.choice(len(_PAINTS), p=_PAINT_SHARES))]
    builder.furniture(body, model, None if paint is None else {paint: (*colour, 1.0)})
    for rectangle in model.footprint_m:
        builder.touched_box(body, rectangle, (0.0, vehicle.card.size_m[2]))
    return body
