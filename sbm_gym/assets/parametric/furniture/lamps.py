"""Lamps that stand or hang."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, turn_x, with_halves


def floor_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A standard lamp with a shade."""
    _lamp(kit, rng, size, 0.3 * size[0] + 0.04, 0.28)


def table_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A table lamp with a shade."""
    _lamp(kit, rng, size, 0.32 * size[0], 0.45 * size[2])


def _lamp(kit: Kit, rng: np.random.Generator, size: Size, foot: float, shade_h: float) -> None:
    w, _, h = size
    stand = paints.metal(rng) if rng.random() < 0.6 else paints.wood(rng)
    tone = np.array([0.95, 0.9, 0.8]) * rng.uniform(0.75, 1.05) + rng.normal(0, 0.04, 3)
    shade = paints.plain(np.clip(tone, 0, 1), 0.0)
    low = h - shade_h
    if h < 0.8 and rng.random() < 0.5:
        heights = [0, 0, 0.3 * low, 0.65 * low, 0.95 * low, low + 0.02, low + 0.02]
        kit.lathe(stand, [0, 0.7, 1, 0.8, 0.2, 0.1, 0], heights, sides=16, scale=(0.3 * w, 1.0))
    else:
        kit.lathe(stand, [0, foot, foot, 0.012, 0.011, 0], [0, 0, 0.012, 0.03, low + 0.02, low + 0.02], sides=16)
    top = float(rng.uniform(0.55, 1.0)) * w / 2
    radii = [w / 2, top, 0.9 * top, 0.2 * top, 0.96 * w / 2, w / 2]
    kit.lathe(shade, radii, [low, h, h, h - 0.01, low + 0.004, low], sides=22)


def desk_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lamp with a jointed arm."""
    w, d, h, _, hd = with_halves(size)
    paint = paints.board(rng) if rng.random() < 0.5 else paints.metal(rng)
    r = 0.32 * min(w, d)
    y = hd - r
    kit.lathe(paint, [0, r, r, 0.02, 0], [0, 0, 0.015, 0.03, 0.03], (0, y), 16)
    elbow = (0, hd - 0.01, 0.55 * h)
    kit.tube(paint, [(0, y, 0.02), elbow], 0.008, sides=6)
    kit.tube(paint, [elbow, (0, -0.1 * d, h - 0.03)], 0.008, sides=6)
    with kit.placed((0, -0.1 * d, h - 0.05), turn_x(-0.7)):
        kit.lathe(paint, [0.42 * w, 0.3 * w, 0.1 * w, 0], [-0.11, -0.03, 0.02, 0.03], sides=14)
        kit.lathe(paint, [0, 0.28 * w, 0.4 * w, 0.42 * w], [0.0, -0.035, -0.11, -0.11], sides=14)


def hanging_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lamp on a cord from the ceiling."""
    w, _, h, hw, _ = with_halves(size)
    shade = paints.board(rng) if rng.random() < 0.6 else paints.metal(rng)
    bulb = paints.plain((1.0, 0.96, 0.86), 0.0)
    high = min(0.3, 0.45 * h)
    kit.tube(paints.BLACK, [(0, 0, high), (0, 0, h - 0.01)], 0.005, sides=5)
    kit.lathe(shade, [0, 0.05, 0.05, 0], [h - 0.03, h - 0.03, h, h], sides=12)
    if rng.random() < 0.3:
        kit.ball(bulb, (0, 0, high / 2), hw, high / 2, rings=10, sides=18)
        return
    kit.lathe(shade, [hw, 0.42 * w, 0.18 * w, 0.03, 0], [0, 0.4 * high, 0.8 * high, high, high], sides=20)
    inside = paints.plain((0.95, 0.93, 0.88), 0.0)
    kit.lathe(inside, [0, 0.17 * w, 0.41 * w, hw], [0.9 * high, 0.78 * high, 0.38 * high, 0], sides=20)
    kit.ball(bulb, (0, 0, 0.45 * high), 0.045, 0.045)
