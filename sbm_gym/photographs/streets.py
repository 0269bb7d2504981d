"""Sets outdoors: one or a few vehicles in a street, a car park, a yard or on a lawn."""

import mujoco
import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.photographs.sets import PhotoScene, SetBuilder, retinted
from sbm_gym.worlds.geometry.placing import Box, Placement, overlap
from sbm_gym.worlds.static_meshes import StaticMeshes, box_quads
from sbm_gym.worlds.towns import materials
from sbm_gym.worlds.towns.furnisher import Furnisher
from sbm_gym.worlds.towns.ground import PAINT, PAINT_M, flat
from sbm_gym.worlds.towns.houses import STYLES, House, build_houses
from sbm_gym.worlds.towns.plan import KERB_M, Rect
from sbm_gym.worlds.towns.weather import draw_weather

USES = {
    **{"car": ("car",), "truck": ("van", "truck"), "bus": ("bus",)},
    **{"motorcycle": ("motorcycle",), "bicycle": ("bicycle",)},
}
"""Uses of the models of each class."""
_COMPANY = ("car", "car", "car", "car", "van", "truck", "bus", "motorcycle", "bicycle")
"""What else stands there, as often as roads have it."""
_AROUND_M = 60.0
_GAP_M = 0.5


def street(category: str, library: FurnitureLibrary, rng: np.random.Generator) -> PhotoScene:
    """Draws a set outdoors.

    Args:
        category: class of the vehicle that is there in any case, a key of ``USES``.
        library: where vehicles and trees come from.
        rng: source of randomness.
    """
    spec = mujoco.MjSpec()
    draw_weather(rng).add_to(spec)
    builder = SetBuilder(spec, library, rng)
    meshes = StaticMeshes(builder.scene, spec.worldbody.add_body(name="ground"))
    vehicles = _vehicles(category, library, rng)
    back_m = max(vehicle.box.corners()[:, 1].max() for vehicle in vehicles)
    kind = str(rng.choice(["asphalt", "paving", "concrete", "grass", "gravel"], p=[0.5, 0.15, 0.12, 0.12, 0.11]))
    own = {"asphalt": materials.asphalt, "grass": materials.grass}
    ground = retinted(own[kind]() if kind in own else materials.material(kind), rng, 0.4)
    meshes.tiled(flat(Rect(-_AROUND_M, -_AROUND_M, _AROUND_M, _AROUND_M), 0.0), ground)
    edge_m = float(back_m + rng.uniform(0.3, 2.0))
    is_street = rng.random() < 0.6
    if is_street:
        _pavement(meshes, edge_m, rng)
    behind_m = edge_m + float(rng.uniform(3.0, 6.0))
    _backdrop(meshes, behind_m, is_street, rng)
    _around(meshes, rng)
    _things(builder, meshes, [vehicle.box for vehicle in vehicles], edge_m, behind_m)
    meshes.build()
    for number, vehicle in enumerate(vehicles):
        builder.stand(vehicle, subject=number == 0 or rng.random() < 0.7)
    floor_m = (-26.0, -26.0, 26.0, behind_m - 0.5)
    return PhotoScene(category, builder, floor_m, ceiling_m=5.0, eye_m=(1.1, 1.75), fov_deg=(36.0, 70.0))


def _vehicles(category: str, library: FurnitureLibrary, rng: np.random.Generator) -> list[Placement]:
    """Vehicles where they stand, the first one near the origin: side by side, in line, or anyhow."""
    first = _pick(library, str(rng.choice(USES[category])), rng)
    assert first is not None, "builtin models serve every class"
    how = str(rng.choice(["line", "row", "anyhow"], p=[0.45, 0.3, 0.25]))
    way = 1.0 if rng.random() < 0.5 else -1.0
    yaw = way * 0.5 * np.pi if how == "line" else 0.0 if how == "row" else float(rng.uniform(-np.pi, np.pi))
    if how == "row" and rng.random() < 0.6:
        yaw += float(rng.uniform(-0.6, 0.6))
    placed = [Placement(first, 0.0, 0.0, yaw)]
    for _ in range(int(rng.choice([0, 1, 2, 3], p=[0.35, 0.3, 0.2, 0.15]))):
        card = _pick(library, str(rng.choice(_COMPANY)), rng)
        if card is None:
            continue
        for _ in range(12):
            if how == "line":
                x, y, turn = rng.uniform(-16.0, 16.0), rng.normal(0.0, 0.1), yaw
            elif how == "row":
                x, y, turn = rng.uniform(-9.0, 9.0), rng.normal(0.0, 0.4), yaw
            else:
                x, y, turn = *rng.uniform(-12.0, 12.0, 2), rng.uniform(-np.pi, np.pi)
            vehicle = Placement(card, float(x), float(y), float(turn) + float(rng.normal(0.0, 0.02)))
            if not any(overlap(vehicle.box, other.box, _GAP_M) for other in placed):
                placed.append(vehicle)
                break
    return placed


def _pick(library: FurnitureLibrary, use: str, rng: np.random.Generator) -> ModelCard | None:
    cards = library.models(use)
    return cards[int(rng.integers(len(cards)))] if cards else None


def _pavement(meshes: StaticMeshes, edge_m: float, rng: np.random.Generator) -> None:
    """A raised pavement from a kerb on, and perhaps markings on the road."""
    low, high = np.array([[-_AROUND_M, edge_m, 0.0]]), np.array([[_AROUND_M, _AROUND_M, KERB_M]])
    meshes.tiled(box_quads(low, high), retinted(materials.material("paving"), rng, 0.4))
    if rng.random() < 0.6:
        line_m = edge_m - float(rng.uniform(4.5, 7.0))
        starts = np.arange(-_AROUND_M, _AROUND_M, 6.0)
        dashes = [flat(Rect(x, line_m - 0.06, x + 3.0, line_m + 0.06), PAINT_M)[0] for x in starts.tolist()]
        meshes.plain(np.array(dashes), PAINT)


def _backdrop(meshes: StaticMeshes, behind_m: float, is_street: bool, rng: np.random.Generator) -> None:
    """Houses, a wall, a hedge or the open behind the vehicles."""

    def slab(deep_m: float, high_m: float) -> np.ndarray:
        low, high = (-_AROUND_M, behind_m, 0.0), (_AROUND_M, behind_m + deep_m, high_m)
        return box_quads(np.array([low]), np.array([high]))

    shares = [0.8, 0.1, 0.05, 0.05] if is_street else [0.4, 0.25, 0.2, 0.15]
    kind = str(rng.choice(["houses", "wall", "hedge", "open"], p=shares))
    if kind == "houses":
        build_houses(meshes, _row(behind_m, 0, rng), rng)
    elif kind == "wall":
        stone = materials.wall_materials(STYLES[rng.integers(3)])
        quads = slab(0.4, rng.uniform(1.6, 6.0))
        meshes.tiled(quads, retinted(stone[rng.integers(len(stone))], rng, 0.5))
    elif kind == "hedge":
        meshes.tiled(slab(1.0, rng.uniform(0.9, 2.6)), retinted(materials.leaves(), rng, 0.3))


def _around(meshes: StaticMeshes, rng: np.random.Generator) -> None:
    """Houses on the other sides, which views along the street show."""
    if rng.random() < 0.6:
        build_houses(meshes, _row(-float(rng.uniform(30.0, 44.0)), 2, rng), rng)
    for side in (1, 3):
        if rng.random() < 0.6:
            build_houses(meshes, _row((side - 2) * float(rng.uniform(32.0, 46.0)), side, rng), rng)


def _row(edge_m: float, side: int, rng: np.random.Generator) -> list[House]:
    """A terrace whose fronts stand at ``edge_m`` along one axis.

    Args:
        edge_m: y of fronts that look south (0) or north (2), x of those that look east (1) or west (3).
        side: where they look.
        rng: source of randomness.
    """
    deep = (edge_m, edge_m + 9.0) if side in (0, 3) else (edge_m - 9.0, edge_m)
    houses: list[House] = []
    along = -float(rng.uniform(28.0, 36.0))
    while along < 28.0:
        wide = (along, along + float(rng.uniform(8.0, 14.0)))
        x, y = (wide, deep) if side in (0, 2) else (deep, wide)
        if rng.random() < 0.9:
            houses.append(_house(Rect(x[0], y[0], x[1], y[1]), side, rng))
        along = wide[1]
    return houses


def _house(rect: Rect, side: int, rng: np.random.Generator) -> House:
    style = STYLES[rng.integers(len(STYLES))]
    walls = materials.wall_materials(style)
    grey = float(rng.uniform(0.5, 0.9))
    return House(
        rect=rect,
        street_sides=(side,),
        style=style,
        storeys=int(rng.integers(1, 4)),
        ground_m=float(rng.uniform(2.9, 4.0)),
        storey_m=float(rng.uniform(2.7, 3.2)),
        wall=retinted(walls[int(rng.integers(len(walls)))], rng, 0.5),
        accent=(grey, 0.97 * grey, 0.92 * grey, 1.0),
        frame=(0.9, 0.9, 0.88, 1.0) if rng.random() < 0.6 else (0.2, 0.19, 0.18, 1.0),
        pitched=bool(rng.random() < 0.5),
        shop=bool(rng.random() < 0.35),
    )


def _things(builder: SetBuilder, meshes: StaticMeshes, reserved: list[Box], edge_m: float, behind_m: float) -> None:
    """Trees, lamps, bins, benches and cones about the vehicles."""
    rng = builder.rng
    furnisher = Furnisher(builder.scene, meshes, builder.library, rng, reserved)
    for _ in range(int(rng.choice([0, 1, 2], p=[0.4, 0.4, 0.2]))):
        place = np.array([rng.uniform(-18.0, 18.0), rng.uniform(edge_m + 0.6, max(behind_m - 0.5, edge_m + 0.7))])
        furnisher.tree(furnisher.pick(str(rng.choice(["street_tree", "park_tree"]))), place)
    for use in ("street_light", "litter_bin", "bench", "traffic_cone"):
        if rng.random() < 0.3:
            place = np.array([rng.uniform(-10.0, 10.0), rng.uniform(edge_m + 0.4, behind_m)])
            if use == "traffic_cone":
                place[1] = rng.uniform(-4.0, edge_m)
            ground_m = KERB_M if place[1] > edge_m else 0.0
            furnisher.stand(furnisher.pick(use), place, float(rng.choice([0.0, np.pi])), ground_m)
