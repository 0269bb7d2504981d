"""Pictures of what towns are made of: asphalt, paving, brick, render, roof tiles, grass, glass, signs.

Pictures of materials tile without a seam. Their seeds are fixed by name, so that all towns share one set.
"""

import functools
import tomllib
import zlib
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.assets.models.surfaces import Material, as_picture, layered_noise, periodic_noise

Colour = tuple[int, int, int]
_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def _rng(name: str) -> np.random.Generator:
    return np.random.default_rng((7, zlib.crc32(name.encode())))


@functools.cache
def asphalt() -> Material:
    """Worn asphalt: fine stones, darker patches, a few sealed cracks."""
    rng, side = _rng("asphalt"), 512
    stones = periodic_noise(rng, (side, side), (0.8, 0.8)) * 0.10
    patches = layered_noise(rng, (side, side), (40, 40, 0.06), (9, 9, 0.03))
    wander = periodic_noise(rng, (side, side), (18, 18))
    cracks = np.exp(-((wander / 0.035) ** 2)) * (periodic_noise(rng, (side, side), (45, 45)) > 0.6)
    shade = (1 + stones + patches) * (1 - 0.22 * cracks)
    return Material(as_picture(np.array([104.0, 104.0, 106.0]), shade), (7.0, 7.0), specular=0.03, shininess=0.1)


@functools.cache
def grass() -> Material:
    """Mown grass."""
    rng, side = _rng("grass"), 512
    blades = layered_noise(rng, (side, side), (1.6, 0.7, 0.16), (4, 4, 0.07))
    patches = periodic_noise(rng, (side, side), (50, 50)) * 0.09
    dry = np.clip(periodic_noise(rng, (side, side), (30, 30)), 0, 2)[..., None] * 0.12
    colour = np.array([86.0, 116.0, 52.0]) * (1 - dry) + np.array([140.0, 132.0, 70.0]) * dry
    return Material(as_picture(colour, 1 + blades + patches), (4.0, 4.0))


@functools.cache
def leaves() -> Material:
    """A clipped hedge."""
    rng, side = _rng("leaves"), 256
    light = np.clip(periodic_noise(rng, (side, side), (2.2, 2.2)), -1.6, 1.6) * 0.34
    fine = layered_noise(rng, (side, side), (0.8, 0.8, 0.10), (14, 14, 0.08))
    return Material(as_picture(np.array([58.0, 84.0, 36.0]), 1 + light + fine), (1.1, 1.1))


@functools.cache
def material(name: str, colour: Colour | None = None) -> Material:
    """A material of ``materials.toml``.

    Args:
        name: its key there.
        colour: what it is painted or cut from (RGB, 0 to 255), for those that have no colour of their own.
    """
    entry, rng = _TABLES["materials"][name], _rng(f"{name}{colour or ''}")
    if "blocks" in entry:
        tone, joint = _blocks(rng, **entry["blocks"])
    else:
        side = entry["size_px"]
        tone, joint = np.zeros((side, side)), np.zeros((side, side), bool)
    grain = layered_noise(rng, tone.shape, *entry["noise"])
    picture = np.array(colour or entry["rgb"], float) * (1 + tone + grain)[..., None]
    if "burnt" in entry:
        picture[tone > entry["burnt"]["from"]] *= entry["burnt"]["shade"]
    if "mortar" in entry:
        picture[joint] = np.array(entry["mortar"], float) * (1 + grain[joint])[:, None]
    else:
        picture[joint] *= entry.get("joint_shade", 1.0)
    width_m, height_m = entry["size_m"]
    return Material(as_picture(picture), (width_m, height_m))


def _blocks(
    rng: np.random.Generator, rows: int, columns: int, tall: int, wide: int, joint_px: int, spread: float
) -> tuple[Float[np.ndarray, "h w"], np.ndarray]:
    """Tones of blocks in running bond, and where the joints are."""
    height, width = rows * tall, columns * wide
    tone, joint = np.zeros((height, width)), np.zeros((height, width), bool)
    for row in range(rows):
        shift = (row % 2) * wide // 2
        tone[row * tall : (row + 1) * tall] = np.roll(np.repeat(rng.normal(0, spread, columns), wide), shift)[None]
        joint[row * tall : row * tall + joint_px] = True
        for column in range(columns):
            at = (column * wide + shift) % width
            joint[row * tall : (row + 1) * tall, at : at + joint_px] = True
    return tone, joint


@functools.cache
def roof_tiles(colour: Colour) -> Material:
    """Rows of curved tiles, seen along the slope."""
    rng = _rng(f"tiles{colour}")
    rows, columns, tall, wide = 12, 12, 32, 32
    tone, _ = _blocks(rng, rows, columns, tall, wide, 1, 0.09)
    y, x = np.mgrid[0 : rows * tall, 0 : columns * wide]
    shift = ((y // tall) % 2) * wide // 2
    curve = 0.78 + 0.22 * np.sin(np.pi * ((x + shift) % wide) / wide)
    shade = curve * (0.72 + 0.28 * ((y % tall) / tall)) * (1 + tone)
    return Material(as_picture(np.array(colour, float), shade), (3.0, 3.6))


@functools.cache
def window_panes() -> tuple[UInt8[np.ndarray, "h w 3"], ...]:
    """What window panes show in daylight: the sky's reflection above, dark rooms below, curtains, blinds, a lamp."""
    pictures = []
    for number in range(6):
        rng = _rng(f"pane{number}")
        height, width = 160, 112
        y, x = np.mgrid[0:height, 0:width] / np.array([height, width]).reshape(2, 1, 1)
        sky = np.array([96.0, 116.0, 136.0]) * (0.55 + 0.35 * (1 - y) ** 1.5)[..., None]
        room = np.array([34.0, 36.0, 40.0]) * (1 + 0.25 * periodic_noise(rng, (height, width), (14, 14)))[..., None]
        slant = np.clip((0.62 + 0.25 * rng.normal() - y + 0.25 * (x - 0.5)) * 5, 0, 1)[..., None]
        picture = room * (1 - 0.75 * slant) + sky * 0.75 * slant
        if number in (1, 3):  # curtains drawn to the sides
            reach = rng.uniform(0.16, 0.3)
            inside = (x < reach) | (x > 1 - reach)
            folds = 0.8 + 0.2 * np.sin(x * rng.uniform(60, 90))
            cloth = np.array([(196, 188, 172), (170, 120, 104)][number // 2], float) * folds[..., None]
            picture = np.where(inside[..., None], 0.72 * cloth + 0.28 * picture, picture)
        if number == 2:  # a roller blind, half down
            blind = y < rng.uniform(0.3, 0.55)
            picture = np.where(blind[..., None], 0.75 * np.array([206.0, 200.0, 186.0]) + 0.25 * picture, picture)
        if number == 4:  # slats
            slats = (np.sin(y * 130) > -0.2)[..., None]
            picture = np.where(slats, 0.6 * np.array([190.0, 190.0, 186.0]) + 0.4 * picture, picture)
        pictures.append(as_picture(picture))
    return tuple(pictures)


@functools.cache
def door(colour: Colour) -> UInt8[np.ndarray, "h w 3"]:
    """A panelled front door with a fanlight, knob and letter slot."""
    height, width = 240, 110
    picture = np.full((height, width, 3), colour, np.float64)
    picture[:38] = (70, 82, 94)
    picture[36:42] = np.array(colour) * 0.7
    for row in range(3):
        for column in range(2):
            top, left = 54 + row * 60, 12 + column * 48
            picture[top : top + 48, left : left + 38] *= 0.86
            picture[top : top + 3, left : left + 38] *= 0.7
            picture[top : top + 48, left : left + 3] *= 0.7
    picture[146:152, 44:66] = (196, 176, 110)
    cv2.circle(picture, (98, 152), 5, (206, 188, 120), -1)
    picture[:, :4] *= 0.75
    picture[:, -4:] *= 0.75
    return as_picture(picture)


@functools.cache
def manhole() -> UInt8[np.ndarray, "h w 3"]:
    """The iron cover of a manhole in its asphalt."""
    side = 96
    y, x = np.mgrid[0:side, 0:side] - side / 2
    radius = np.hypot(x, y)
    picture = np.broadcast_to(np.array([104.0, 104.0, 106.0]), (side, side, 3)).copy()
    lozenge = ((x.astype(int) // 6 + y.astype(int) // 6) % 2) * 14.0
    iron = np.array([66.0, 64.0, 62.0]) + lozenge[..., None]
    picture = np.where((radius < 44)[..., None], iron, picture)
    picture = np.where(((radius > 38) & (radius < 41))[..., None], 40.0, picture)
    return as_picture(picture)


@functools.cache
def road_sign(kind: str) -> UInt8[np.ndarray, "h w 4"]:
    """A road sign with a transparent surround.

    Args:
        kind: ``no_entry``, ``limit`` or ``parking``.
    """
    centre, picture = (80, 80), np.zeros((160, 160, 4), np.uint8)
    red, white, blue, black = (188, 24, 32, 255), (244, 244, 240, 255), (24, 78, 160, 255), (20, 20, 20, 255)
    if kind == "parking":
        cv2.rectangle(picture, (6, 6), (154, 154), blue, -1)
    else:
        cv2.circle(picture, centre, 76, red, -1)
    if kind == "no_entry":
        cv2.rectangle(picture, (28, 66), (132, 94), white, -1)
    else:
        text, scale, ink = ("P", 3.4, white) if kind == "parking" else ("30", 2.2, black)
        if kind == "limit":
            cv2.circle(picture, centre, 58, white, -1)
        (wide, tall), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 4)
        at = (centre[0] - wide // 2, centre[1] + tall // 2)
        cv2.putText(picture, text, at, cv2.FONT_HERSHEY_DUPLEX, scale, ink, 4, cv2.LINE_AA)
    # Transparent texels take a neighbouring colour, so that filtering never draws a dark rim.
    picture[picture[..., 3] == 0, :3] = 200
    return picture


@functools.cache
def wall_materials(style: str) -> tuple[Material, ...]:
    """The walls that a style of building can have."""
    walls = _TABLES["walls"][style]
    return tuple(material(walls["material"], (r, g, b)) for r, g, b in walls["colours"])
