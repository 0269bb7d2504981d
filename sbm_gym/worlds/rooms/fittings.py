"""What a room is fitted with: pictures on its walls, rugs on its floor, lamps under its ceiling."""

import mujoco
import numpy as np

from sbm_gym.assets.models import surfaces
from sbm_gym.worlds.geometry.placing import Room
from sbm_gym.worlds.rooms.openings import UPRIGHT, upright_rectangle, wall_box
from sbm_gym.worlds.scene_builder import DRAWN, SceneBuilder


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
            wall_box(builder, body, wall, (start, end), (0.0, 0.02), (low, low + height), frame)
            inner = upright_rectangle(wall, start + 0.03, end - 0.03, low + 0.03, low + height - 0.03, 0.022)
            builder.quads(body, inner[None], UPRIGHT[None], builder.material(picture=surfaces.painting(rng)))
            break


def lay_rug(
    builder: SceneBuilder, body: mujoco.MjsBody, largest_m: tuple[float, float, float], rng: np.random.Generator
) -> None:
    """Gives a body the looks of a woven rug, up to a size, lying on the floor around the body's origin."""
    half_x, half_y = 0.5 * np.array(largest_m[:2]) * rng.uniform(0.75, 1.0, 2)
    picture = surfaces.rug(rng)
    thick = 0.012
    top = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [half_x, half_y]
    corners = np.concatenate([top, np.full((4, 1), thick)], axis=1)
    texcoords = UPRIGHT
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
        top = room.height_m
        cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
        body.add_geom(type=cylinder, pos=[*at, top - 0.02], size=[0.2, 0.02, 0], material=rim, **DRAWN)
        body.add_geom(type=cylinder, pos=[*at, top - 0.055], size=[0.185, 0.015, 0], material=shade, **DRAWN)
        builder.spec.worldbody.add_light(
            name=f"{name}_{index}",
            type=mujoco.mjtLightType.mjLIGHT_POINT,
            # Well below the lamp, whose shadow on the ceiling is then no wider than the lamp.
            pos=[*at, top - 0.35],
            dir=[0, 0, -1],
            diffuse=(brightness * warm).tolist(),
            specular=(0.3 * brightness * warm).tolist(),
            ambient=[0, 0, 0],
            # Falls off as in a room with pale walls, whose bounces fill in: 1 at 2 m, half at 5 m.
            attenuation=[0.7, 0.0, 0.06],
            castshadow=True,
        )
