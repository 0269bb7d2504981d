"""What is seen of openings in walls: frames, doors and their leaves, windows with curtains."""

import itertools

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.assets.models import surfaces
from sbm_gym.worlds.geometry.placing import Box, Opening, Wall, yaw_quaternion
from sbm_gym.worlds.rooms.floor_plan import INNER_WALL_M
from sbm_gym.worlds.scene_builder import SceneBuilder

REVEAL_M = 0.12
"""How deep windows and doors lie in the wall."""
UPRIGHT = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
"""Texture coordinates that fill an `upright_rectangle` with one picture."""
Rgba = tuple[float, float, float, float]


def upright_rectangle(
    wall: Wall, start: float, end: float, low: float, high: float, out: float
) -> Float[np.ndarray, "4 3"]:
    """Corners of an upright rectangle parallel to a wall, counter-clockwise as seen from the room."""
    a, b = wall.point(start, out), wall.point(end, out)
    # The wall runs with the room on its left, so from inside its start is on the right.
    return np.array([[*b, low], [*a, low], [*a, high], [*b, high]])


def wall_box(builder, body, wall: Wall, along, out, height, material: str) -> None:
    """A drawn box given along a wall, out from it and in height, each as (from, to)."""
    a, b = wall.point(along[0], out[0]), wall.point(along[1], out[1])
    builder.drawn_box(body, np.array([*a, height[0]]), np.array([*b, height[1]]), material)


def draw_frame(builder: SceneBuilder, body: mujoco.MjsBody, wall: Wall, o: Opening, trim: str) -> None:
    """The sides of an opening in the depth of the wall, and a frame around it on the wall.

    Each of the two rooms beside a passage draws its half of it.
    """
    deep = 0.5 * INNER_WALL_M if o.kind == "passage" else REVEAL_M
    sides = ((o.start_m, o.start_m + 0.02), (o.end_m - 0.02, o.end_m))
    for along in sides:
        wall_box(builder, body, wall, along, (-deep, 0.0), (o.low_m, o.high_m), trim)
    wall_box(builder, body, wall, (o.start_m, o.end_m), (-deep, 0.0), (o.high_m - 0.02, o.high_m), trim)
    # Flush with the sides inside: a step there would lie in the dark and read as a dashed line from afar.
    for along in ((o.start_m - 0.06, o.start_m + 0.02), (o.end_m - 0.02, o.end_m + 0.06)):
        wall_box(builder, body, wall, along, (0.0, 0.02), (o.low_m, o.high_m - 0.02), trim)
    top = (o.high_m - 0.02, o.high_m + 0.06)
    wall_box(builder, body, wall, (o.start_m - 0.06, o.end_m + 0.06), (0.0, 0.02), top, trim)
    if o.kind == "passage":
        wall_box(builder, body, wall, (o.start_m, o.end_m), (-deep, 0.0), (-0.01, 0.004), trim)
    if o.low_m > 0:
        wall_box(
            builder, body, wall, (o.start_m - 0.08, o.end_m + 0.08), (-deep, 0.05), (o.low_m - 0.03, o.low_m), trim
        )


def draw_front_door(builder: SceneBuilder, wall: Wall, o: Opening, colour: Rgba, panels: int, name: str) -> None:
    """A closed door in its opening."""
    middle = wall.point(0.5 * (o.start_m + o.end_m), -0.08)
    half = 0.5 * (o.end_m - o.start_m)
    # Its own x axis runs from the hinge to the handle.
    yaw = float(np.arctan2(-wall.along[1], -wall.along[0]))
    hang_leaf(builder, f"door_{name}_front", Box(*middle, half, 0.02, yaw, 0.0, o.high_m), colour, panels)


def hang_leaf(builder: SceneBuilder, name: str, leaf: Box, colour: Rgba, panels: int) -> mujoco.MjsBody:
    """Adds a door leaf: panels on both sides, handles near the end of its own x axis.

    Args:
        builder: the scene.
        name: of its body.
        leaf: where it is.
        colour: of its paint.
        panels: how many panels it has, one above the other; 0 for a plain leaf.

    Returns:
        Its body, with the leaf's middle as origin, on the floor.
    """
    position_m, turn = [leaf.x_m, leaf.y_m, 0.0], yaw_quaternion(leaf.yaw_rad)
    body = builder.spec.worldbody.add_body(name=name, pos=position_m, quat=turn)
    paint = builder.material(rgba=colour, specular=0.2)
    inset = builder.material(rgba=(0.9 * colour[0], 0.9 * colour[1], 0.9 * colour[2], 1.0), specular=0.2)
    steel = builder.material(rgba=(0.6, 0.6, 0.62, 1.0), specular=0.8, shininess=0.7)
    half, thick, high = leaf.half_x_m, leaf.half_y_m, leaf.high_m - leaf.low_m
    builder.drawn_box(body, np.array([-half, -thick, 0.0]), np.array([half, thick, high]), paint)
    top_panel, edge = (1.12, high - 0.15), 0.72 * half
    levels = [[], [(0.15, high - 0.15)], [(0.15, 0.9), top_panel], [(0.15, 0.62), (0.74, 0.98), top_panel]]
    for low, top in levels[panels]:
        builder.drawn_box(body, np.array([-edge, -thick - 0.004, low]), np.array([edge, thick + 0.004, top]), inset)
    x = half - 0.07
    for side in (-1.0, 1.0):
        plate, neck, grip = side * (thick + 0.006), side * (thick + 0.034), side * (thick + 0.046)
        builder.drawn_box(body, np.array([x - 0.02, side * thick, 0.94]), np.array([x + 0.02, plate, 1.12]), steel)
        builder.drawn_box(body, np.array([x - 0.009, plate, 1.04]), np.array([x + 0.009, grip, 1.058]), steel)
        builder.drawn_box(body, np.array([x - 0.12, neck, 1.04]), np.array([x - 0.009, grip, 1.058]), steel)
    return body


def draw_window(
    builder: SceneBuilder, body: mujoco.MjsBody, wall: Wall, o: Opening, trim: str, rng: np.random.Generator
) -> None:
    """A window: its bars, and what one sees through it."""
    view = builder.material(picture=surfaces.landscape(rng), emission=0.75)
    pane = upright_rectangle(wall, o.start_m, o.end_m, o.low_m, o.high_m, -REVEAL_M + 0.01)
    builder.quads(body, pane[None], UPRIGHT[None], view)
    depth = (-REVEAL_M + 0.01, -REVEAL_M + 0.06)
    panes = max(round((o.end_m - o.start_m) / 0.7), 1)
    for index in range(panes + 1):
        at = o.start_m + (o.end_m - o.start_m) * index / panes
        wall_box(
            builder, body, wall, (max(at - 0.03, o.start_m), min(at + 0.03, o.end_m)), depth, (o.low_m, o.high_m), trim
        )
    for low in (o.low_m, o.high_m - 0.06):
        wall_box(builder, body, wall, (o.start_m, o.end_m), depth, (low, low + 0.06), trim)


def draw_curtains(
    builder: SceneBuilder, body: mujoco.MjsBody, wall: Wall, o: Opening, height_m: float, cloth: str
) -> None:
    """A folded curtain at each side of a window, from a rod above it; they end above sills and radiators."""
    low, high = max(o.low_m - 0.12, 0.1), min(o.high_m + 0.14, height_m - 0.06)
    for start, end in ((o.start_m - 0.28, o.start_m + 0.08), (o.end_m - 0.08, o.end_m + 0.28)):
        if start < 0.02 or end > wall.length_m - 0.02:
            continue
        folds = zip(np.linspace(start, end, 17), 0.05 + 0.025 * np.sin(np.arange(17) * 0.5 * np.pi), strict=True)
        edges = itertools.pairwise([wall.point(along, out) for along, out in folds])
        front = np.array([[[*b, low], [*a, low], [*a, high], [*b, high]] for a, b in edges])
        u = np.arange(16)[:, None, None] / 8
        texcoords = np.array([[0.125, 3.0], [0.0, 3.0], [0.0, 0.0], [0.125, 0.0]]) + u * [1.0, 0.0]
        # Seen from the window side too, by whoever stands beside it.
        both = np.concatenate([front, front[:, ::-1]])
        builder.quads(body, both, np.concatenate([texcoords, texcoords[:, ::-1]]), cloth)
    rod = builder.material(rgba=(0.3, 0.28, 0.26, 1.0), specular=0.5)
    span = (max(o.start_m - 0.3, 0.01), min(o.end_m + 0.3, wall.length_m - 0.01))
    wall_box(builder, body, wall, span, (0.04, 0.06), (high, high + 0.02), rod)
