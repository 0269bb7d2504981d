"""The room itself: floor, walls with their openings, ceiling, skirting, a door, windows, pictures, lamps."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.worlds import surfaces
from sbm_gym.worlds.building import SceneBuilder
from sbm_gym.worlds.floor_plan import INNER_WALL_M, FloorPlan
from sbm_gym.worlds.placing import Opening, Room, Wall

REVEAL_M = 0.12
"""How deep windows and doors lie in the wall."""


@dataclass(frozen=True)
class Finish:
    """What a room is covered with."""

    floor: surfaces.Material
    wall: surfaces.Material
    ceiling: surfaces.Material
    trim: tuple[float, float, float, float]
    """Colour of skirting and frames."""
    door: tuple[float, float, float, float]


@dataclass(frozen=True)
class Style:
    """What all rooms of a home share."""

    trim: tuple[float, float, float, float]
    door: tuple[float, float, float, float]
    floor: surfaces.Material
    """Of the rooms that have no floor of their own kind."""
    wall: surfaces.Material


def draw_style(rng: np.random.Generator) -> Style:
    """Draws what all rooms of a home share."""
    trims = ((0.93, 0.93, 0.91, 1.0), (0.93, 0.93, 0.91, 1.0), (0.86, 0.84, 0.80, 1.0), (0.45, 0.33, 0.22, 1.0))
    doors = ((0.90, 0.89, 0.86, 1.0), (0.55, 0.40, 0.27, 1.0), (0.72, 0.58, 0.42, 1.0))
    floors = (surfaces.wood_planks, surfaces.wood_planks, surfaces.parquet, surfaces.tiles)
    return Style(
        trim=trims[rng.integers(len(trims))],
        door=doors[rng.integers(len(doors))],
        floor=floors[rng.integers(len(floors))](rng),
        wall=surfaces.plaster(rng),
    )


def draw_finish(kind: str, style: Style, rng: np.random.Generator) -> Finish:
    """Draws the finish of a room of a kind: offices rarely have planks, kitchens never carpet, bathrooms are tiled."""
    floors = {
        "office": (surfaces.carpet, surfaces.carpet, surfaces.tiles),
        "meeting_room": (surfaces.carpet,),
        "kitchen": (surfaces.tiles,),
        "bathroom": (surfaces.tiles,),
        "wash_room": (surfaces.tiles,),
        "hotel_room": (surfaces.carpet, surfaces.wood_planks),
        "bedroom": (surfaces.carpet, surfaces.wood_planks, None, None),
    }.get(kind, (None,))
    walls = {
        "bathroom": (surfaces.wall_tiles,),
        "wash_room": (surfaces.wall_tiles,),
        "hall": (None,),
        "office": (None, surfaces.plaster),
        "meeting_room": (None, surfaces.plaster),
        "kitchen": (None, surfaces.plaster),
    }.get(kind, (None, surfaces.plaster, surfaces.wallpaper))
    floor, wall = floors[rng.integers(len(floors))], walls[rng.integers(len(walls))]
    return Finish(
        floor=style.floor if floor is None else floor(rng),
        wall=style.wall if wall is None else wall(rng),
        ceiling=surfaces.ceiling(rng),
        trim=style.trim,
        door=style.door,
    )


def build_shell(
    builder: SceneBuilder, room: Room, finish: Finish, rng: np.random.Generator, name: str, curtains: bool = False
) -> None:
    """Adds what is seen of a room's floor, walls, ceiling and openings to the scene.

    Args:
        builder: the scene.
        room: the room.
        finish: what it is covered with.
        rng: source of randomness.
        name: of the room's body, and part of the names of its geoms.
        curtains: whether curtains hang beside its windows.
    """
    body = builder.spec.worldbody.add_body(name=name)
    (x0, y0), (x1, y1) = room.low_m, room.high_m
    h = room.height_m
    floor = np.array([[[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]]], float)
    top = np.array([[[x0, y0, h], [x0, y1, h], [x1, y1, h], [x1, y0, h]]], float)
    builder.tiled_quads(body, floor, finish.floor, f"{name}_floor")
    # Lamps hang just below the ceiling and hardly light it; what it gets comes back from the floor.
    builder.tiled_quads(body, top, finish.ceiling, f"{name}_ceiling", emission=0.3)
    trim = builder.material(rgba=finish.trim, specular=0.1)
    cloth = builder.material(picture=surfaces.curtain(rng)) if curtains else None
    panels = []
    for wall in room.walls():
        openings = [opening for opening in room.openings if opening.wall == wall.index]
        panels += [_rectangle(wall, *panel, 0.0) for panel in _panels(wall.length_m, h, openings)]
        for start, end in _gaps(wall.length_m, [o for o in openings if o.kind != "window"]):
            _box(builder, body, wall, (start, end), (0.0, 0.015), (0.0, 0.08), trim)
        for opening in openings:
            _reveal(builder, body, wall, opening, trim)
            if opening.kind == "door":
                _door(builder, body, wall, opening, finish, trim, rng)
            elif opening.kind == "window":
                _window(builder, body, wall, opening, finish, trim, rng)
                if cloth is not None:
                    _curtains(builder, body, wall, opening, h, cloth)
    builder.tiled_quads(body, np.stack(panels), finish.wall, f"{name}_walls")


def build_walls(builder: SceneBuilder, plan: FloorPlan, height_m: float) -> None:
    """Adds what is touched of a plan's walls to the scene."""
    body = builder.spec.worldbody.add_body(name="walls")
    for rectangle in plan.solid_rectangles():
        builder.touched_box(body, np.array(rectangle), (0.0, height_m))


def _panels(length_m: float, height_m: float, openings: list[Opening]) -> list[tuple[float, float, float, float]]:
    """Rectangles (start, end, low, high) of wall around its openings."""
    panels, at = [], 0.0
    for opening in sorted(openings, key=lambda o: o.start_m):
        panels.append((at, opening.start_m, 0.0, height_m))
        if opening.low_m > 0:
            panels.append((opening.start_m, opening.end_m, 0.0, opening.low_m))
        panels.append((opening.start_m, opening.end_m, opening.high_m, height_m))
        at = opening.end_m
    panels.append((at, length_m, 0.0, height_m))
    return panels


def _gaps(length_m: float, openings: list[Opening]) -> list[tuple[float, float]]:
    """Stretches of a wall between openings."""
    at, gaps = 0.0, []
    for opening in sorted(openings, key=lambda o: o.start_m):
        gaps.append((at, opening.start_m - 0.06))
        at = opening.end_m + 0.06
    return [*gaps, (at, length_m)]


def _rectangle(wall: Wall, start: float, end: float, low: float, high: float, out: float) -> Float[np.ndarray, "4 3"]:
    """Corners of an upright rectangle parallel to a wall, counter-clockwise as seen from the room."""
    a, b = wall.point(start, out), wall.point(end, out)
    # The wall runs with the room on its left, so from inside its start is on the right.
    return np.array([[*b, low], [*a, low], [*a, high], [*b, high]])


_UPRIGHT = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
"""Texture coordinates that fill a ``_rectangle`` with one picture, upright."""


def _box(builder, body, wall: Wall, along, out, height, material: str) -> None:
    """A drawn box given along a wall, out from it and in height, each as (from, to)."""
    a, b = wall.point(along[0], out[0]), wall.point(along[1], out[1])
    builder.drawn_box(body, np.array([*a, height[0]]), np.array([*b, height[1]]), material)


def _reveal(builder: SceneBuilder, body: mujoco.MjsBody, wall: Wall, o: Opening, trim: str) -> None:
    """The sides of an opening in the depth of the wall, and a frame around it on the wall.

    Each of the two rooms beside a passage draws its half of it.
    """
    deep = 0.5 * INNER_WALL_M if o.kind == "passage" else REVEAL_M
    sides = ((o.start_m, o.start_m + 0.02), (o.end_m - 0.02, o.end_m))
    for along in sides:
        _box(builder, body, wall, along, (-deep, 0.0), (o.low_m, o.high_m), trim)
    _box(builder, body, wall, (o.start_m, o.end_m), (-deep, 0.0), (o.high_m - 0.02, o.high_m), trim)
    for along in ((o.start_m - 0.06, o.start_m), (o.end_m, o.end_m + 0.06)):
        _box(builder, body, wall, along, (0.0, 0.02), (o.low_m, o.high_m), trim)
    _box(builder, body, wall, (o.start_m - 0.06, o.end_m + 0.06), (0.0, 0.02), (o.high_m, o.high_m + 0.06), trim)
    if o.kind == "passage":
        _box(builder, body, wall, (o.start_m, o.end_m), (-deep, 0.0), (-0.01, 0.004), trim)
    if o.low_m > 0:
        _box(builder, body, wall, (o.start_m - 0.08, o.end_m + 0.08), (-deep, 0.05), (o.low_m - 0.03, o.low_m), trim)


def _door(builder, body, wall: Wall, o: Opening, finish: Finish, trim: str, rng: np.random.Generator) -> None:
    leaf = builder.material(rgba=finish.door, specular=0.2)
    inset = builder.material(rgba=(*(0.92 * c for c in finish.door[:3]), 1.0), specular=0.2)
    steel = builder.material(rgba=(0.6, 0.6, 0.62, 1.0), specular=0.8, shininess=0.7)
    _box(builder, body, wall, (o.start_m, o.end_m), (-0.10, -0.06), (0.0, o.high_m), leaf)
    width = o.end_m - o.start_m
    for low, high in ((0.15, 0.9), (1.05, o.high_m - 0.15)):
        _box(
            builder, body, wall, (o.start_m + 0.15 * width, o.end_m - 0.15 * width), (-0.06, -0.052), (low, high), inset
        )
    _box(builder, body, wall, (o.start_m + 0.06, o.start_m + 0.19), (-0.02, -0.005), (1.0, 1.02), steel)
    _box(builder, body, wall, (o.start_m + 0.06, o.start_m + 0.08), (-0.06, -0.005), (1.0, 1.02), steel)


def _window(builder, body, wall: Wall, o: Opening, finish: Finish, trim: str, rng: np.random.Generator) -> None:
    view = builder.material(picture=surfaces.landscape(rng), emission=0.75)
    pane = _rectangle(wall, o.start_m, o.end_m, o.low_m, o.high_m, -REVEAL_M + 0.01)
    builder.quads(body, pane[None], _UPRIGHT[None], view)
    depth = (-REVEAL_M + 0.01, -REVEAL_M + 0.06)
    panes = max(round((o.end_m - o.start_m) / 0.7), 1)
    for index in range(panes + 1):
        at = o.start_m + (o.end_m - o.start_m) * index / panes
        _box(
            builder, body, wall, (max(at - 0.03, o.start_m), min(at + 0.03, o.end_m)), depth, (o.low_m, o.high_m), trim
        )
    for low in (o.low_m, o.high_m - 0.06):
        _box(builder, body, wall, (o.start_m, o.end_m), depth, (low, low + 0.06), trim)


def _curtains(builder: SceneBuilder, body: mujoco.MjsBody, wall: Wall, o: Opening, height_m: float, cloth: str) -> None:
    """A folded curtain at each side of a window, from a rod above it; they end above sills and radiators."""
    low, high = max(o.low_m - 0.12, 0.1), min(o.high_m + 0.14, height_m - 0.06)
    for start, end in ((o.start_m - 0.28, o.start_m + 0.08), (o.end_m - 0.08, o.end_m + 0.28)):
        if start < 0.02 or end > wall.length_m - 0.02:
            continue
        steps = 16
        along = np.linspace(start, end, steps + 1)
        out = 0.05 + 0.025 * np.sin(np.arange(steps + 1) * 0.5 * np.pi)
        quads, coords = [], []
        for k in range(steps):
            a, b = wall.point(along[k], out[k]), wall.point(along[k + 1], out[k + 1])
            u0, u1 = 2.0 * k / steps, 2.0 * (k + 1) / steps
            quads.append([[*b, low], [*a, low], [*a, high], [*b, high]])
            coords.append([[u1, 3.0], [u0, 3.0], [u0, 0.0], [u1, 0.0]])
        # Seen from the window side too, by whoever stands beside it.
        front, uv = np.array(quads), np.array(coords)
        builder.quads(body, np.concatenate([front, front[:, ::-1]]), np.concatenate([uv, uv[:, ::-1]]), cloth)
    rod = builder.material(rgba=(0.3, 0.28, 0.26, 1.0), specular=0.5)
    span = (max(o.start_m - 0.3, 0.01), min(o.end_m + 0.3, wall.length_m - 0.01))
    _box(builder, body, wall, span, (0.04, 0.06), (high, high + 0.02), rod)


def hang_pictures(
    builder: SceneBuilder,
    room: Room,
    taken: list[tuple[int, float, float]],
    rng: np.random.Generator,
    name: str = "pictures",
    most: int = 3,
) -> None:
    """Hangs framed pictures on free stretches of wall.

    Args:
        builder: the scene.
        room: the room.
        taken: stretches (wall, start, end) at eye level that are not free.
        rng: source of randomness.
        name: of their body.
        most: the greatest number of pictures.
    """
    body = builder.spec.worldbody.add_body(name=name)
    walls = room.walls()
    taken = list(taken)
    for _ in range(int(rng.integers(0 if most == 1 else 1, most + 1))):
        for _ in range(12):
            wall = walls[rng.integers(4)]
            width, height = rng.uniform(0.4, 0.9), rng.uniform(0.35, 0.7)
            if wall.length_m < width + 0.6:
                continue
            start = rng.uniform(0.3, wall.length_m - width - 0.3)
            end = start + width
            if any(index == wall.index and start < b + 0.1 and end > a - 0.1 for index, a, b in taken):
                continue
            taken.append((wall.index, start, end))
            low = 1.6 - height / 2
            tones = ((0.1, 0.1, 0.1, 1.0), (0.5, 0.36, 0.2, 1.0), (0.9, 0.9, 0.88, 1.0))
            frame = builder.material(rgba=tones[rng.integers(3)], specular=0.2)
            _box(builder, body, wall, (start, end), (0.0, 0.02), (low, low + height), frame)
            inner = _rectangle(wall, start + 0.03, end - 0.03, low + 0.03, low + height - 0.03, 0.022)
            builder.quads(body, inner[None], _UPRIGHT[None], builder.material(picture=surfaces.painting(rng)))
            break


def lay_rug(
    builder: SceneBuilder,
    body: mujoco.MjsBody,
    largest_m: tuple[float, float, float],
    rng: np.random.Generator,
) -> None:
    """Gives a body the looks of a woven rug, up to a size, lying on the floor around the body's origin."""
    half_x, half_y = 0.5 * np.array(largest_m[:2]) * rng.uniform(0.75, 1.0, 2)
    picture = surfaces.rug(rng)
    thick = 0.012
    top = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [half_x, half_y]
    corners = np.concatenate([top, np.full((4, 1), thick)], axis=1)
    texcoords = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    if half_y > half_x:
        texcoords = texcoords[:, ::-1]
    builder.quads(body, corners[None], texcoords[None], builder.material(picture=picture))
    tone = tuple(float(c) for c in picture[0, 0] / 255.0)
    edge = builder.material(rgba=(tone[0], tone[1], tone[2], 1.0))
    low = np.array([-half_x, -half_y, 0.0])
    builder.drawn_box(body, low, np.array([half_x, half_y, thick - 0.001]), edge)


def hang_lamps(builder: SceneBuilder, room: Room, rng: np.random.Generator, name: str, count: int) -> None:
    """Ceiling lamps along the longer side of a room, each with a light below it.

    Args:
        builder: the scene.
        room: the room.
        rng: source of randomness.
        name: of their body, and part of the lights' names.
        count: how many; they share what one would give.
    """
    length, width = room.size_m
    middle = 0.5 * (np.array(room.low_m) + np.array(room.high_m))
    axis = 0 if length >= width else 1
    spacing = max(length, width) / count
    warm = np.array([1.0, rng.uniform(0.93, 1.0), rng.uniform(0.82, 0.97)])
    body = builder.spec.worldbody.add_body(name=name)
    shade = builder.material(rgba=(1.0, 0.98, 0.94, 1.0), emission=0.8)
    rim = builder.material(rgba=(0.7, 0.7, 0.72, 1.0), specular=0.6)
    brightness = rng.uniform(0.9, 1.05) / count
    for index in range(count):
        at = middle.copy()
        at[axis] += (index - (count - 1) / 2) * spacing
        drawn = {"group": 2, "contype": 0, "conaffinity": 0, "mass": 0}
        top = room.height_m
        cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
        body.add_geom(type=cylinder, pos=[*at, top - 0.02], size=[0.2, 0.02, 0], material=rim, **drawn)
        body.add_geom(type=cylinder, pos=[*at, top - 0.055], size=[0.185, 0.015, 0], material=shade, **drawn)
        builder.spec.worldbody.add_light(
            name=f"{name}_{index}",
            type=mujoco.mjtLightType.mjLIGHT_POINT,
            pos=[*at, top - 0.12],
            dir=[0, 0, -1],
            diffuse=(brightness * warm).tolist(),
            specular=(0.3 * brightness * warm).tolist(),
            ambient=[0, 0, 0],
            # Falls off as in a room with pale walls, whose bounces fill in: 1 at 2 m, half at 5 m.
            attenuation=[0.7, 0.0, 0.06],
            castshadow=True,
        )
