"""Lorries and buses made from seeds. They look towards -Y."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, with_halves
from sbm_gym.assets.parametric.parts.vehicle_parts import DARK, GLASS, LAMP, TAIL, arch, lacquer, loft, wheel


def truck(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lorry: a cab, and a box or an open bed behind it."""
    w, d, h, hw, _ = with_halves(size)
    cab = lacquer(rng)
    half, front, back, r = 0.48 * w, -d / 2, d / 2, 0.48
    cab_h, cab_end = min(h, 2.75) - 0.05, front + 1.9
    floor = 1.02
    kit.box(DARK, (-0.36 * w, front + 0.3, 0.5), (0.36 * w, back - 0.05, floor))
    loft(
        kit,
        cab,
        [
            (front, 0.94 * half, 0.42, 1.55),
            (front + 0.03, half, 0.4, 1.62),
            (front + 0.22, half, 0.4, cab_h - 0.1),
            (front + 0.4, half, 0.4, cab_h),
            (cab_end, half, 0.4, cab_h),
        ],
        0.1,
    )
    a, b, low, high = 0.86 * half, 0.82 * half, front + 0.02, front + 0.2
    kit.card(GLASS, [(-a, low, 1.66), (a, low, 1.66), (b, high, cab_h - 0.2), (-b, high, cab_h - 0.2)])
    kit.box(DARK, (-0.7 * half, front - 0.004, 0.85), (0.7 * half, front + 0.03, 1.35))
    kit.box(DARK, (-half, front + 0.01, 0.36), (half, front + 0.2, 0.62), bevel=0.03)
    for sx in (-1, 1):
        x = sx * (half + 0.004)
        window = [(front + 0.35, 1.6), (front + 1.3, 1.6), (front + 1.3, cab_h - 0.3), (front + 0.5, cab_h - 0.3)]
        kit.prism(GLASS, window, 0, min(x, x - sx * 0.03), max(x, x - sx * 0.03))
        kit.box(DARK, (sx * half, front + 0.2, 1.6), (sx * hw, front + 0.3, 2.1), bevel=0.02)
        kit.box(LAMP, (sx * 0.6 * half, front - 0.002, 0.66), (sx * 0.9 * half, front + 0.1, 0.82))
        wheels = [front + 0.95, back - 0.22 * d] + ([back - 0.22 * d + 1.15] if d > 7.5 else [])
        for y in wheels:
            wheel(kit, sx * half, y, r, 0.3)
        kit.box(TAIL, (sx * 0.7 * half, back - 0.06, 0.75), (sx * 0.95 * half, back, 0.92))
    load = lacquer(rng) if rng.random() < 0.5 else paints.plain((0.86, 0.86, 0.84), 0.2)
    if rng.random() < 0.65:
        kit.box(load, (-hw + 0.02, cab_end + 0.12, floor), (hw - 0.02, back, h), bevel=0.03)
        kit.box(DARK, (-0.004, back - 0.01, floor + 0.1), (0.004, back + 0.003, h - 0.1))
    else:
        kit.box(load, (-hw + 0.02, cab_end + 0.12, floor), (hw - 0.02, back, floor + 0.12))
        side = floor + 0.7
        kit.box(load, (-hw + 0.02, cab_end + 0.12, floor), (hw - 0.02, cab_end + 0.2, h))
        kit.box(load, (-hw + 0.02, back - 0.08, floor), (hw - 0.02, back, side))
        for sx in (-1, 1):
            kit.box(load, (sx * (hw - 0.02), cab_end + 0.12, floor), (sx * (hw - 0.1), back, side))


def bus(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A city bus."""
    w, d, h = size
    paint = lacquer(rng)
    half, front, back, r = 0.47 * w, -d / 2, d / 2, 0.48
    loft(
        kit,
        paint,
        [
            (front, 0.93 * half, 0.4, h - 0.2),
            (front + 0.12, half, 0.32, h - 0.05),
            (front + 0.4, half, 0.32, h),
            (back - 0.15, half, 0.32, h),
            (back, 0.96 * half, 0.4, h - 0.12),
        ],
        0.12,
    )
    band = paints.plain((0.9, 0.9, 0.88), 0.4) if rng.random() < 0.6 else paints.darker(paint, 0.6)
    low, high = 1.15, h - 0.55
    for sx in (-1, 1):
        x = sx * (half + 0.006)
        a, b = sorted((x, x - sx * 0.04))
        kit.box(GLASS, (a, front + 0.5, low), (b, back - 0.6, high))
        kit.box(band, (a, front + 0.3, 0.72), (b, back - 0.3, 0.95))
        for y in np.arange(front + 1.9, back - 1.0, 1.5):
            kit.box(paint, (a - 0.003, y - 0.05, low), (b + 0.003, y + 0.05, high))
        for y in (front + 0.24 * d, back - 0.25 * d):
            arch(kit, sx * half, y, r)
            wheel(kit, sx * (half + 0.012), y, r, 0.3)
        kit.box(LAMP, (sx * 0.6 * half, front - 0.004, 0.62), (sx * 0.88 * half, front + 0.05, 0.8))
        kit.box(TAIL, (sx * 0.75 * half, back - 0.03, 0.7), (sx * 0.9 * half, back + 0.004, 1.1))
        kit.box(DARK, (sx * half, front + 0.05, h - 1.2), (sx * w / 2, front + 0.15, h - 0.75), bevel=0.02)
    for y in (front + 0.55, front + 0.5 * d):  # doors on the right, seen from the driver's seat
        kit.box(DARK, (-half - 0.012, y, 0.42), (-half + 0.02, y + 1.15, high + 0.08))
        for k in (0.06, 0.6):
            kit.box(GLASS, (-half - 0.016, y + k, 0.55), (-half, y + k + 0.49, high))
    kit.box(GLASS, (-0.86 * half, front - 0.006, 1.05), (0.86 * half, front + 0.04, h - 0.6))
    display = paints.plain((0.95, 0.6, 0.1), 0.2)
    kit.box(display, (-0.5 * half, front - 0.004, h - 0.5), (0.5 * half, front + 0.04, h - 0.28))
    kit.box(GLASS, (-0.8 * half, back - 0.03, 1.5), (0.8 * half, back + 0.004, h - 0.6))
