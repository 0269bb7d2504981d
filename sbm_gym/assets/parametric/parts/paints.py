"""What builtin models are covered with: woods, fabrics, leathers, metals, painted boards, made from noise."""

import colorsys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.assets.models.surfaces import as_picture, periodic_noise

SIDE_PX = 128
"""Pictures are small: a tile covers half a metre, and models are looked at from a metre away."""


@dataclass(frozen=True, eq=False)
class Paint:
    """The look of a part."""

    rgb: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Display colour, each in [0, 1]; white where there is a picture."""
    texture: UInt8[np.ndarray, "h w 3"] | None = None
    tile_m: float | None = 0.5
    """Length that one picture covers; None where a part brings texture coordinates of its own."""
    specular: float = 0.0
    shininess: float = 0.3
    alpha: float = 1.0
    """Below 1 it is glass."""


def picture(colour: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """A picture of colours in [0, 1]."""
    return as_picture(255.0 * colour)


def _tone(rng: np.random.Generator, hue, saturation, value) -> Float[np.ndarray, "3"]:
    """A colour drawn from ranges of hue, saturation and value."""
    return np.array(
        colorsys.hsv_to_rgb(rng.uniform(*hue) % 1.0, float(rng.uniform(*saturation)), float(rng.uniform(*value)))
    )


def plain(rgb: Sequence[float] | Float[np.ndarray, "3"], specular: float = 0.1, shininess: float = 0.3) -> Paint:
    """One colour: red, green and blue, each in [0, 1]."""
    return Paint((float(rgb[0]), float(rgb[1]), float(rgb[2])), specular=specular, shininess=shininess)


BLACK = plain((0.035, 0.035, 0.04), 0.5, 0.7)
CHROME = plain((0.72, 0.73, 0.75), 0.9, 0.8)
CERAMIC = plain((0.93, 0.93, 0.92), 0.6, 0.7)
STEEL = plain((0.62, 0.63, 0.65), 0.7, 0.7)
GLASS = Paint((0.80, 0.88, 0.90), specular=0.9, shininess=0.9, alpha=0.25)
WOODS = ((0.55, 0.36, 0.22), (0.72, 0.53, 0.34), (0.82, 0.68, 0.48), (0.36, 0.23, 0.15), (0.62, 0.45, 0.30))


def wood(rng: np.random.Generator) -> Paint:
    """Varnished wood with its grain along the first texture axis."""
    base = np.array(WOODS[rng.integers(len(WOODS))]) * rng.uniform(0.85, 1.1)
    fine = periodic_noise(rng, (SIDE_PX, SIDE_PX), (0.8, 14.0))
    rings = periodic_noise(rng, (SIDE_PX, SIDE_PX), (3.0, 26.0))
    shade = 1 + 0.06 * fine + 0.07 * np.sin(3.0 * rings)
    return Paint(texture=picture(base * shade[..., None]), tile_m=0.6, specular=0.15, shininess=0.4)


def board(rng: np.random.Generator) -> Paint:
    """A painted or laminated board: mostly white, grey or black, now and then a colour."""
    draw = rng.random()
    if draw < 0.5:
        value = rng.uniform(0.82, 0.95)
        colour = np.array([value, value, value * rng.uniform(0.95, 1.0)])
    elif draw < 0.75:
        colour = np.full(3, rng.choice([0.12, 0.2, 0.45, 0.6]))
    else:
        colour = _tone(rng, (0.0, 1.0), (0.25, 0.6), (0.4, 0.8))
    return plain(colour, 0.2, 0.5)


def wood_or_board(rng: np.random.Generator, wooden: float = 0.6) -> Paint:
    """Wood with a probability, else a board."""
    return wood(rng) if rng.random() < wooden else board(rng)


def metal(rng: np.random.Generator) -> Paint:
    """Chrome, steel, black or white lacquered metal."""
    tones = ((0.75, 0.76, 0.78), (0.55, 0.56, 0.58), (0.08, 0.08, 0.09), (0.9, 0.9, 0.88), (0.62, 0.5, 0.3))
    return plain(tones[rng.integers(len(tones))], 0.7, 0.7)


def _ground(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    """The colour of a fabric: greys, beiges and browns as often as real colours."""
    draw = rng.random()
    if draw < 0.3:
        return np.full(3, rng.uniform(0.2, 0.85)) * [1.0, rng.uniform(0.96, 1.0), rng.uniform(0.92, 1.02)]
    if draw < 0.55:
        return _tone(rng, (0.06, 0.12), (0.15, 0.45), (0.4, 0.85))
    return _tone(rng, (0.0, 1.0), (0.3, 0.75), (0.3, 0.75))


def fabric(rng: np.random.Generator, patterned: float = 0.35) -> Paint:
    """Woven cloth, plain or with stripes, checks, dots or a leaf pattern."""
    ground = _ground(rng)
    n = SIDE_PX
    y, x = np.mgrid[0:n, 0:n] / n
    colour = np.broadcast_to(ground, (n, n, 3)).copy()
    if rng.random() < patterned:
        light = rng.random() < 0.6
        other = np.clip(ground * 0.45 + 0.5, 0, 1) if light else _ground(rng)
        kind, count = int(rng.integers(5)), int(rng.integers(2, 6))
        if kind == 0:
            figure = np.sin(2 * np.pi * count * x) > rng.uniform(-0.4, 0.5)
        elif kind == 1:
            a, b = np.sin(2 * np.pi * count * x) > 0, np.sin(2 * np.pi * count * y) > 0
            colour = colour * (1 - 0.25 * (a ^ b)[..., None])
            figure = a & b
        elif kind == 2:
            u, v = (x * count) % 1 - 0.5, (y * count) % 1 - 0.5
            figure = np.hypot(u, v) < rng.uniform(0.15, 0.32)
        elif kind == 3:
            figure = (np.abs((x * count + 0.5 * np.abs(((y * count) % 1) * 2 - 1)) % 1 - 0.5)) < 0.16
        else:
            u, v = (x * count) % 1 - 0.5, (y * count) % 1 - 0.5
            figure = np.hypot(u, v) < 0.4 * np.abs(np.cos(rng.integers(2, 4) * np.arctan2(v, u)))
        colour[figure] = other
    weave = 1 + 0.05 * periodic_noise(rng, (n, n), (0.6, 0.6)) + 0.012 * periodic_noise(rng, (n, n), (9, 9))
    return Paint(texture=picture(colour * weave[..., None]), tile_m=float(rng.uniform(0.25, 0.5)))


def leather(rng: np.random.Generator) -> Paint:
    """Leather: a dark tone with soft blotches and a slight shine."""
    tones = ((0.24, 0.13, 0.08), (0.1, 0.1, 0.1), (0.45, 0.26, 0.14), (0.78, 0.74, 0.68), (0.35, 0.08, 0.07))
    base = np.array(tones[rng.integers(len(tones))]) * rng.uniform(0.85, 1.2)
    blotches = periodic_noise(rng, (SIDE_PX, SIDE_PX), (7, 7))
    shade = 1 + 0.035 * blotches + 0.04 * periodic_noise(rng, (SIDE_PX, SIDE_PX), (0.8, 0.8))
    return Paint(texture=picture(base * shade[..., None]), tile_m=0.5, specular=0.25, shininess=0.4)


def upholstery(rng: np.random.Generator) -> Paint:
    """What couches are covered with: mostly plain cloth, sometimes leather."""
    return leather(rng) if rng.random() < 0.3 else fabric(rng, 0.12)


def darker(paint: Paint, factor: float) -> Paint:
    """The same paint in another tone."""
    texture = None if paint.texture is None else picture(paint.texture / 255.0 * factor)
    rgb = paint.rgb if texture is not None else tuple(float(np.clip(c * factor, 0, 1)) for c in paint.rgb)
    return Paint((rgb[0], rgb[1], rgb[2]), texture, paint.tile_m, paint.specular, paint.shininess, paint.alpha)


def leaf(rng: np.random.Generator) -> Paint:
    """A green."""
    return plain(_tone(rng, (0.22, 0.36), (0.45, 0.8), (0.22, 0.5)), 0.12, 0.3)


def books(rng: np.random.Generator) -> Paint:
    """A row of book spines; texture coordinates run from 0 to 1 over the row."""
    n, at = SIDE_PX, 0
    colour = np.zeros((64, n, 3))
    while at < n:
        width = int(rng.integers(4, 10))
        tone = _tone(rng, (0.0, 1.0), (0.1, 0.8), (0.2, 0.9))
        top = int(rng.integers(0, 14))
        colour[top:, at : at + width] = tone
        band = int(rng.integers(18, 48))
        colour[band : band + int(rng.integers(3, 10)), at + 1 : at + width - 1] = np.clip(tone + 0.3, 0, 1)
        colour[:, at] *= 0.5
        at += width
    return Paint(texture=picture(colour), tile_m=None)
