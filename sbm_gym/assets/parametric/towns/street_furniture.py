"""Street lamps, benches, bins and cones, and cafe tables and chairs, parasols and fountains, made from seeds."""

import itertools

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, turn_z, with_halves
from sbm_gym.assets.parametric.parts.vehicle_parts import DARK, lacquer


def street_light(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A street lamp: a mast with an arm, or a lantern on a post."""
    w, d, h, _, hd = with_halves(size)
    post = paints.plain(((0.1, 0.11, 0.1), (0.5, 0.51, 0.52), (0.12, 0.2, 0.16))[rng.integers(3)], 0.4)
    glow = paints.plain((1.0, 0.96, 0.85), 0.2)
    if h > 4.5:
        y = hd - 0.12
        kit.lathe(post, [0, 0.12, 0.12, 0.07, 0.045, 0], [0, 0, 0.25, 0.35, h - 0.5, h - 0.5], (0, y), 10)
        arm = [(0, y, h - 0.55), (0, y - 0.1, h - 0.15), (0, 0, h - 0.05), (0, -hd + 0.4, h - 0.05)]
        kit.tube(post, arm, 0.035, sides=7)
        kit.box(post, (-0.12, -hd, h - 0.09), (0.12, -hd + 0.5, h), bevel=0.03)
        kit.box(glow, (-0.09, -hd + 0.05, h - 0.105), (0.09, -hd + 0.45, h - 0.08))
        return
    r = 0.5 * min(w, d)
    heights = [0, 0, 0.15, 0.4, 0.5, h - 0.75, h - 0.68, h - 0.68]
    kit.lathe(post, [0, 0.7, 0.7, 0.35, 0.2, 0.17, 0.35, 0], heights, sides=12, scale=(r, 1.0))
    kit.lathe(glow, [0.5 * r, 0.9 * r, 0], [h - 0.68, h - 0.25, h - 0.25], sides=6)
    kit.lathe(post, [r, 0.95 * r, 0.2 * r, 0.1 * r, 0], [h - 0.26, h - 0.22, h - 0.05, h, h], sides=6)


def bench(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A park bench with slats."""
    w, _, h, hw, hd = with_halves(size)
    slat = paints.wood(rng) if rng.random() < 0.75 else lacquer(rng)
    iron = paints.plain((0.09, 0.1, 0.1), 0.3)
    seat = 0.44
    for x in (-0.42 * w, 0.42 * w):
        side = [(-hd + 0.04, 0), (-hd + 0.08, seat - 0.02), (hd - 0.18, seat - 0.05), (hd - 0.03, h - 0.02)]
        kit.tube(iron, [(x, y, z) for y, z in side], 0.022, sides=6)
        kit.tube(iron, [(x, hd - 0.05, 0), (x, hd - 0.18, seat - 0.05)], 0.022, sides=6)
        kit.tube(iron, [(x, -hd + 0.06, 0.2), (x, -hd + 0.05, seat + 0.2), (x, hd - 0.1, seat + 0.2)], 0.018, sides=6)
    for y in np.linspace(-hd + 0.07, hd - 0.2, 4):
        kit.box(slat, (-hw, y - 0.045, seat - 0.02), (hw, y + 0.045, seat + 0.012), bevel=0.006)
    for t in np.linspace(0.3, 1.0, 3):
        y, z = hd - 0.2 + 0.15 * t, seat + t * (h - seat) - 0.05
        kit.box(slat, (-hw, y - 0.02, z - 0.045), (hw, y + 0.012, z + 0.045), bevel=0.006)


def litter_bin(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A litter bin of slats around a drum."""
    w, _, h = size
    r = w / 2
    paint = lacquer(rng)
    kit.lathe(DARK, [0, 0.85, 0.85, 0.7, 0.7, 0], [0, 0, 0.95, 0.95, 0.5, 0.5], sides=14, scale=(r, h))
    for a in np.arange(14) * 2 * np.pi / 14:
        with kit.placed(rotation=turn_z(float(a))):
            kit.box(paint, (-0.16 * r, -0.97 * r, 0.06 * h), (0.16 * r, -0.86 * r, 0.94 * h))
    kit.lathe(paint, [0.84, 1, 1, 0.75, 0.75, 0.84], [0.94, 0.94, 1, 1, 0.94, 0.94], sides=20, scale=(r, h))


def traffic_cone(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A traffic cone."""
    w, _, h, hw, _ = with_halves(size)
    orange = paints.plain((0.92, 0.3 + 0.08 * float(rng.random()), 0.05), 0.2)
    white = paints.plain((0.93, 0.93, 0.92), 0.2)
    kit.box(orange if rng.random() < 0.6 else DARK, (-hw, -hw, 0), (hw, hw, 0.035), bevel=0.008)
    foot, tip = 0.38 * w, 0.08 * w
    levels = [0.035, 0.35 * h, 0.52 * h, 0.68 * h, 0.82 * h, h]
    for number, (a, b) in enumerate(itertools.pairwise(levels)):
        r0, r1 = (foot + (tip - foot) * (z - 0.035) / (h - 0.035) for z in (a, b))
        radii, heights = ([r0, r1, 0.0], [a, b, h]) if b == h else ([r0, r1], [a, b])
        kit.lathe(white if number in (1, 3) else orange, radii, heights, sides=18)


def cafe_chair(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A light chair of metal and slats."""
    _, _, h, hw, hd = with_halves(size)
    metal, slat = paints.metal(rng), paints.wood(rng) if rng.random() < 0.6 else lacquer(rng)
    seat = 0.45
    for x in (-hw + 0.015, hw - 0.015):
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
    stone = paints.plain(np.array([0.62, 0.6, 0.56]) * rng.uniform(0.85, 1.1), 0.05)
    water = paints.plain((0.2, 0.36, 0.42), 0.9, 0.9)
    r, rim = w / 2, 0.24 * h
    kit.lathe(stone, [0, r, r, 0.88 * r, 0.86 * r, 0], [0, 0, rim, rim, 0.5 * rim, 0.5 * rim], sides=28)
    kit.lathe(water, [0.87 * r, 0], [0.85 * rim, 0.85 * rim], sides=28)
    heights = [0.5 * rim, 0.35 * h, 0.6 * h, 0.74 * h, 0.75 * h, 0.68 * h, 0.9 * h, h, h]
    kit.lathe(stone, [0.24, 0.12, 0.1, 0.45, 0.42, 0.12, 0.06, 0.09, 0], heights, sides=20, scale=(r, 1.0))
    kit.lathe(water, [0.4 * r, 0.1 * r], [0.735 * h, 0.735 * h], sides=20)
