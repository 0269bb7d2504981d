"""The room itself: floor, walls around their openings, ceiling, skirting."""

from dataclasses import dataclass

import numpy as np

from sbm_gym.assets.models import surfaces
from sbm_gym.worlds.geometry.placing import Opening, Room
from sbm_gym.worlds.rooms.floor_plan import ROOM_KINDS, FloorPlan
from sbm_gym.worlds.rooms.openings import (
    draw_curtains,
    draw_frame,
    draw_front_door,
    draw_window,
    hang_leaf,
    upright_rectangle,
    wall_box,
)
from sbm_gym.worlds.scene_builder import SceneBuilder


@dataclass(frozen=True)
class Style:
    """What all rooms of a home share."""

    trim: tuple[float, float, float, float]
    """Colour of skirting and frames."""
    door: tuple[float, float, float, float]
    panels: int
    """Of a door."""
    floor: surfaces.Material
    """Of the rooms that have no floor of their own kind."""
    wall: surfaces.Material


@dataclass(frozen=True)
class Finish(Style):
    """What a room is covered with."""

    ceiling: surfaces.Material


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
        panels=int(rng.integers(4)),
    )


def draw_finish(kind: str, style: Style, rng: np.random.Generator) -> Finish:
    """Draws the finish of a room of a kind: offices rarely have planks, kitchens never carpet, bathrooms are tiled."""
    own = ROOM_KINDS[kind]
    floor, wall = own.floors[rng.integers(len(own.floors))], own.walls[rng.integers(len(own.walls))]
    covered = {
        "floor": getattr(surfaces, floor)(rng) if floor else style.floor,
        "wall": getattr(surfaces, wall)(rng) if wall else style.wall,
        "ceiling": surfaces.ceiling(rng),
    }
    return Finish(**(vars(style) | covered))


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
        panels += [upright_rectangle(wall, *panel, 0.0) for panel in _panels(wall.length_m, h, openings)]
        for start, end in _gaps(wall.length_m, [o for o in openings if o.kind != "window"]):
            wall_box(builder, body, wall, (start, end), (0.0, 0.015), (0.0, 0.08), trim)
        for opening in openings:
            draw_frame(builder, body, wall, opening, trim)
            if opening.kind == "door":
                draw_front_door(builder, wall, opening, finish.door, finish.panels, name)
            elif opening.kind == "window":
                draw_window(builder, body, wall, opening, trim, rng)
                if cloth is not None:
                    draw_curtains(builder, body, wall, opening, h, cloth)
    builder.tiled_quads(body, np.stack(panels), finish.wall, f"{name}_walls")
    for index, leaf in enumerate(room.leaves):
        hung = hang_leaf(builder, f"door_{name}_{index}", leaf, finish.door, finish.panels)
        half_x, half_y = leaf.half_x_m, leaf.half_y_m
        builder.touched_box(hung, np.array([-half_x, -half_y, half_x, half_y]), (leaf.low_m, leaf.high_m))


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
