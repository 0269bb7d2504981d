"""Sets indoors: one or a few pieces of furniture in part of a room."""

from collections.abc import Callable

import mujoco
import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.assets.models import surfaces
from sbm_gym.photographs.sets import PhotoScene, SetBuilder, retinted
from sbm_gym.worlds.geometry.placing import Layout, Opening, Room
from sbm_gym.worlds.rooms.fittings import hang_pictures, lay_rug
from sbm_gym.worlds.rooms.furnishing.arranger import Arranger
from sbm_gym.worlds.rooms.furnishing.bathroom import bathing
from sbm_gym.worlds.rooms.furnishing.bedroom import sleeping
from sbm_gym.worlds.rooms.furnishing.extras import greening, standing_lamp
from sbm_gym.worlds.rooms.furnishing.kitchen import put_kitchen
from sbm_gym.worlds.rooms.furnishing.living_room import lounging, put_television, sitting
from sbm_gym.worlds.rooms.furnishing.tables import dining, working
from sbm_gym.worlds.rooms.shell import Finish, build_shell
from sbm_gym.worlds.towns import materials

MAX_TRIANGLES = 120_000
"""Of all pieces together, so that a set takes a fraction of a second to build."""
_FLOORS = (surfaces.wood_planks, surfaces.parquet, surfaces.carpet, surfaces.tiles)
_WALLS = (surfaces.plaster, surfaces.plaster, surfaces.wallpaper)


def _table(a: Arranger) -> None:
    card = a.pick(str(a.rng.choice(["dining_table", "coffee_table", "desk"])))
    if card is not None and a.layout.in_the_open(card, around_m=0.4):
        a.decorate(a.layout.placements[-1], ("table_thing", "small_plant", "desk_lamp"), 0.5)


def _plants_on_a_support(a: Arranger) -> None:
    support = a.along_wall(str(a.rng.choice(["dresser", "coffee_table", "desk", "tv_stand"])))
    if support is not None:
        a.decorate(support, ("small_plant", "small_plant", "table_thing"), 0.8)


def _chairs(a: Arranger) -> None:
    for _ in range(int(a.rng.integers(1, 4))):
        lounging(a, str(a.rng.choice(["dining_chair", "office_chair", "lounge_chair"], p=[0.5, 0.2, 0.3])))


def _dining_chair(a: Arranger) -> None:
    lounging(a, "dining_chair")


THEMES: dict[str, tuple[tuple[float, Callable[[Arranger], object]], ...]] = {
    "chair": ((1.0, _chairs), (0.3, standing_lamp)),
    "couch": ((1.0, lambda a: sitting(a, lounge=0.5, television=a.chance(0.35))), (0.4, greening)),
    "plant": ((0.7, greening), (1.0, _plants_on_a_support), (0.4, greening)),
    "tv": ((1.0, lambda a: put_television(a, supports=("tv_stand", "dresser"))), (0.4, greening), (0.2, lounging)),
    "fridge": ((1.0, lambda a: put_kitchen(a, int(a.rng.integers(0, 4)))), (0.25, lambda a: dining(a, (1, 2)))),
    "bed": (
        (1.0, lambda a: sleeping(a, "double_bed" if a.chance(0.6) else "single_bed")),
        (0.3, greening),
        (0.3, _dining_chair),
    ),
    "table": ((1.0, _table), (0.4, _dining_chair)),
    "toilet": ((1.0, lambda a: bathing(a, "bathtub" if a.chance(0.3) else None)), (0.4, lambda a: a.small("bin"))),
    "dining": ((1.0, lambda a: dining(a, (1, 4))), (0.3, greening)),
    "desk": ((1.0, working), (0.3, greening)),
}
"""What furnishes a set, by what it is mostly about: steps and their probabilities."""
_DISTRACTORS = ("shelf", "dresser", "cupboard", "bin", "floor_lamp", "nightstand", "beanbag", "office_cabinet")


def interior(theme: str, library: FurnitureLibrary, rng: np.random.Generator) -> PhotoScene:
    """Draws a set indoors.

    Args:
        theme: a key of ``THEMES``.
        library: where the furniture comes from.
        rng: source of randomness.
    """
    room = _room(theme, rng)
    layout = Layout(room, rng)
    arranger = Arranger(layout, library, MAX_TRIANGLES, max_objects=8)
    for probability, furnish in THEMES[theme]:
        if probability == 1.0 or arranger.chance(probability):
            furnish(arranger)
    for _ in range(int(rng.integers(0, 3))):
        card = arranger.pick(str(rng.choice(_DISTRACTORS)))
        if card is not None:
            layout.against_wall(card, tries=10)
    spec = mujoco.MjSpec()
    spec.visual.headlight.active = 0
    spec.visual.headlight.ambient = [float(rng.uniform(0.18, 0.42))] * 3
    builder = SetBuilder(spec, library, rng)
    bare = theme == "toilet"
    build_shell(builder.scene, room, _finish(theme, rng), rng, "room", curtains=bool(not bare and rng.random() < 0.5))
    hang_pictures(builder.scene, room, _taken(layout), rng, most=1 if bare else 3)
    _light(spec, room, rng)
    for number, rug in enumerate(layout.rugs):
        lay_rug(builder.scene, builder.scene.place(f"rug_{number}", rug), rug.card.size_m, rng)
    for piece in layout.placements:
        builder.stand(piece)
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    floor_m = (x0 + 0.15, y0 + 0.15, x1 - 0.15, y1 - 0.15)
    return PhotoScene(theme, builder, floor_m, room.height_m - 0.3, eye_m=(0.7, 1.65), fov_deg=(42.0, 74.0))


def _room(theme: str, rng: np.random.Generator) -> Room:
    """A room with a window or two, a door in most."""
    low = 2.2 if theme == "toilet" else 3.6
    width, depth = rng.uniform(low, low + 2.6, 2).tolist()
    height = float(rng.uniform(2.4, 3.1))
    lengths = (width, depth, width, depth)
    openings: list[Opening] = []
    for wall, kind in enumerate(("window", "door", "window", "none")):
        if rng.random() < 0.45:
            continue
        at = (wall + int(rng.integers(4))) % 4
        span = float(rng.uniform(0.9, 1.8)) if kind == "window" else 0.85
        if kind == "none" or span > lengths[at] - 0.8 or any(opening.wall == at for opening in openings):
            continue
        start = float(rng.uniform(0.4, lengths[at] - span - 0.4))
        heights = (float(rng.uniform(0.8, 1.0)), 2.15) if kind == "window" else (0.0, 2.05)
        openings.append(Opening(kind, at, start, start + span, *heights))
    return Room((-width / 2, -depth / 2), (width / 2, depth / 2), height, tuple(openings))


def _finish(theme: str, rng: np.random.Generator) -> Finish:
    floors, walls = _FLOORS, _WALLS
    if theme == "toilet":
        floors, walls = (surfaces.tiles,), (surfaces.wall_tiles, surfaces.plaster)
    wall = walls[rng.integers(len(walls))](rng)
    if theme != "toilet" and rng.random() < 0.15:
        bare = materials.wall_materials("brick" if rng.random() < 0.6 else "modern")
        wall = bare[rng.integers(len(bare))]
    wood, white = (0.5, 0.37, 0.25, 1.0), (0.92, 0.92, 0.9, 1.0)
    return Finish(
        floor=retinted(floors[rng.integers(len(floors))](rng), rng, 0.5),
        wall=retinted(wall, rng, 0.8),
        ceiling=surfaces.ceiling(rng),
        trim=white if rng.random() < 0.75 else wood,
        door=white if rng.random() < 0.5 else wood,
        panels=int(rng.integers(4)),
    )


def _light(spec: mujoco.MjSpec, room: Room, rng: np.random.Generator) -> None:
    """One or two lamps anywhere below the ceiling, from warm to cool."""
    count = int(rng.integers(1, 3))
    warm = np.array([1.0, rng.uniform(0.86, 1.0), rng.uniform(0.7, 1.05)])
    for index in range(count):
        at = rng.uniform(np.array(room.low_m) * 0.8, np.array(room.high_m) * 0.8)
        strength = rng.uniform(0.7, 1.1) / count * warm
        spec.worldbody.add_light(
            name=f"lamp_{index}",
            type=mujoco.mjtLightType.mjLIGHT_POINT,
            pos=[*at, room.height_m - rng.uniform(0.1, 0.7)],
            dir=[0, 0, -1],
            diffuse=strength.tolist(),
            specular=(0.3 * strength).tolist(),
            ambient=[0, 0, 0],
            attenuation=[0.7, 0.0, 0.06],
            castshadow=True,
        )


def _taken(layout: Layout) -> list[tuple[int, float, float]]:
    """Stretches of wall at eye level with an opening or something tall before them."""
    taken = [(o.wall, o.start_m - 0.35, o.end_m + 0.35) for o in layout.room.openings]
    for wall in layout.room.walls():
        for piece in layout.placements:
            low, high, out = wall.shadow(piece.box)
            if piece.box.high_m > 1.1 and out < 0.4:
                taken.append((wall.index, low, high))
    return taken
