"""What stands on squares, made from seeds: cafe tables and chairs, parasols, fountains."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size
from sbm_gym.assets.parametric.parts.vehicle_parts import DARK, lacquer


def cafe_chair(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A light chair of metal and slats."""
    w, d, h = size
    hw, hd = w / 2, d / 2
    metal, slat = paints.metal(rng), paints.wood(rng) if rng.random() < 0.6 else lacquer(rng)
    seat = 0.45
    for sx in (-1, 1):
        x = sx * (hw - 0.015)
        kit.tube(metal, [(x, -hd + 0.02, 0), (x, -hd + 0.05, seat)], 0.012, sides=6)
        kit.tube(metal, [(x, hd - 0.02, 0), (x, hd - 0.09, seat), (x, hd - 0.015, h)], 0.012, sides=6)
    for y in np.linspace(-hd + 0.05, hd - 0.12, 5):
        kit.box(slat, (-hw, y - 0.03, seat - 0.01), (hw, y + 0.03, seat + 0.012))
    for z in np.linspace(seat + 0.18, h - 0.04, 3):
        y = hd - 0.09 + 0.075 * (z - seat) / (h - seat)
        kit.box(slat, (-hw, y - 0.02, z - 0.03), (hw, y + 0.004, z + 0.03))


def cafe_table(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A small round table on one leg."""
    w, _, h = size
    metal = paints.metal(rng)
    top = paints.wood(rng) if rng.random() < 0.5 else paints.board(rng)
    kit.lathe(metal, [0, 0.34 * w, 0.34 * w, 0.03, 0.025, 0], [0, 0, 0.015, 0.05, h - 0.03, h - 0.03], sides=16)
    kit.lathe(top, [0, w / 2, w / 2, 0], [h - 0.03, h - 0.03, h, h], sides=24)


def parasol(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A parasol on a foot."""
    w, _, h = size
    cloth = paints.fabric(rng, 0.3)
    post = paints.wood(rng)
    kit.lathe(DARK, [0, 0.25, 0.25, 0.05, 0], [0, 0, 0.06, 0.1, 0.1], sides=14)
    kit.tube(post, [(0, 0, 0.05), (0, 0, h)], 0.022, sides=8)
    rim = h - 0.16 * w
    kit.lathe(cloth, [w / 2, w / 2, 0], [rim - 0.14, rim, h - 0.02], sides=8)
    kit.lathe(paints.darker(cloth, 0.8), [0, 0.495 * w, 0.495 * w], [h - 0.03, rim - 0.005, rim - 0.14], sides=8)


def fountain(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A round fountain with a basin and a bowl."""
    w, _, h = size
    stone = paints.plain(tuple(float(c) for c in np.array([0.62, 0.6, 0.56]) * rng.uniform(0.85, 1.1)), 0.05)
    water = paints.plain((0.2, 0.36, 0.42), 0.9, 0.9)
    r, rim = w / 2, 0.24 * h
    kit.lathe(stone, [0, r, r, 0.88 * r, 0.86 * r, 0], [0, 0, rim, rim, 0.5 * rim, 0.5 * rim], sides=28)
    kit.lathe(water, [0.87 * r, 0], [0.85 * rim, 0.85 * rim], sides=28)
    kit.lathe(
        stone,
        [0.24 * r, 0.12 * r, 0.1 * r, 0.45 * r, 0.42 * r, 0.12 * r, 0.06 * r, 0.09 * r, 0],
        [0.5 * rim, 0.35 * h, 0.6 * h, 0.74 * h, 0.75 * h, 0.68 * h, 0.9 * h, h, h],
        sides=20,
    )
    kit.lathe(water, [0.4 * r, 0.1 * r], [0.735 * h, 0.735 * h], sides=20)
