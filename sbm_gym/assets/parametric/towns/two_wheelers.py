"""Bicycles and motorcycles made from seeds. They look towards -Y."""

import numpy as np

from sbm_gym.assets.parametric.parts.shapes import Kit, Size, circle, with_halves
from sbm_gym.assets.parametric.parts.vehicle_parts import (
    DARK,
    LAMP,
    PLATE,
    RIM,
    TAIL,
    TYRE,
    lacquer,
    loft,
    spoked_wheel,
    wheel,
)


def bicycle(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bicycle."""
    w, d, h = size
    frame = lacquer(rng)
    r = min(0.345, 0.34 * h)
    yf, yb = -d / 2 + r, d / 2 - r
    spoked_wheel(kit, yf, r)
    spoked_wheel(kit, yb, r)
    crank, seat, head = (0, 0.06 * d, 0.29), (0, 0.14 * d, 0.82 * h), (0, yf + 0.17, 0.83 * h)
    neck = (0, yf + 0.12, 0.66 * h)
    low = float(rng.uniform(0.25, 0.9))
    top = tuple(np.array(crank) + low * (np.array(seat) - np.array(crank)) * 0.95)
    for a, b in ((crank, seat), (crank, neck), (top, head), (crank, (0, yb, r)), (top, (0, yb, r)), (head, (0, yf, r))):
        kit.tube(frame, [a, b], 0.019, sides=7)
    stem, grip, end = (0, yf + 0.16, 0.95 * h), (yf + 0.16, 0.985 * h), (yf + 0.3, 0.97 * h)
    handlebar = [(-w / 2, *end), (-0.4 * w, *grip), stem, (0.4 * w, *grip), (w / 2, *end)]
    kit.tube(DARK, handlebar, 0.014, sides=6)
    kit.tube(frame, [head, stem], 0.015, sides=6)
    kit.tube(RIM, [seat, (0, 0.15 * d, 0.88 * h)], 0.013, sides=6)
    kit.box(DARK, (-0.07, 0.09 * d, 0.88 * h), (0.07, 0.09 * d + 0.26, 0.92 * h), bevel=0.018)
    kit.prism(DARK, circle((crank[1], 0.29), 0.09, 12), 0, 0.025, 0.035)
    for sx, way in ((-1, 1), (1, -1)):
        y, z = crank[1] + way * 0.05, way * 0.16
        kit.tube(RIM, [(sx * 0.05, crank[1], 0.29), (sx * 0.06, y, 0.29 - z)], 0.01, sides=5)
        kit.box(DARK, (sx * 0.06, y - 0.04, 0.28 - z), (sx * 0.15, y + 0.04, 0.3 - z))
    if rng.random() < 0.4:
        kit.box(DARK, (-0.07, yb - 0.25, 2 * r + 0.03), (0.07, yb + 0.15, 2 * r + 0.045))


def motorcycle(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A motorcycle or scooter."""
    w, d, h, _, hd = with_halves(size)
    paint = lacquer(rng)
    scooter = rng.random() < 0.4
    r = 0.22 if scooter else 0.31
    yf, yb = -hd + r, hd - r - 0.03
    for y in (yf, yb):
        for sx in (-1, 1):
            wheel(kit, sx * 0.06, y, r, 0.06)
    kit.tube(RIM, [(0, yf, r), (0, yf + 0.28, 0.82 * h)], 0.03, sides=7)
    grip, end = (yf + 0.28, 0.9 * h), (yf + 0.42, 0.86 * h)
    handlebar = [(-w / 2, *end), (-0.3 * w, *grip), (0.3 * w, *grip), (w / 2, *end)]
    kit.tube(DARK, handlebar, 0.018, sides=6)
    kit.box(LAMP, (-0.08, yf + 0.14, 0.72 * h), (0.08, yf + 0.24, 0.72 * h + 0.15), bevel=0.03)
    seat = 0.66 * h
    if scooter:
        kit.box(paint, (-0.2, yf + 0.26, 0.3), (0.2, yf + 0.34, 0.8 * h), bevel=0.03)
        kit.box(paint, (-0.17, yf + 0.3, 0.2), (0.17, yb, 0.32), bevel=0.03)
        tops = [seat - 0.06, seat, seat + 0.02]
        loft(kit, paint, [0.02 * d, 0.2 * d, hd - 0.06], [0.14, 0.18, 0.1], [0.28, 0.3, 0.42], tops, 0.05)
        kit.box(DARK, (-0.14, 0.02 * d, seat - 0.03), (0.14, hd - 0.1, seat + 0.06), bevel=0.035)
        if rng.random() < 0.4:
            kit.box(DARK, (-0.18, hd - 0.3, seat + 0.06), (0.18, hd, seat + 0.36), bevel=0.05)
    else:
        kit.box(DARK, (-0.17, -0.13 * d, 0.26), (0.17, 0.1 * d, 0.5), bevel=0.05)
        for z in np.linspace(0.3, 0.48, 4):
            kit.box(RIM, (-0.2, -0.1 * d, z), (0.2, 0.05 * d, z + 0.015))
        lows, tops = [0.58 * h, 0.52 * h, 0.54 * h], [0.74 * h, 0.84 * h, 0.72 * h]
        loft(kit, paint, [-0.22 * d, -0.1 * d, 0.08 * d], [0.1, 0.16, 0.11], lows, tops, 0.06)
        lows, tops = [0.52 * h, 0.56 * h, 0.66 * h], [0.66 * h, 0.7 * h, 0.74 * h]
        loft(kit, paint, [0.06 * d, 0.3 * d, hd - 0.04], [0.1, 0.12, 0.06], lows, tops, 0.04)
        kit.box(DARK, (-0.12, 0.04 * d, 0.66 * h), (0.12, 0.36 * d, 0.74 * h), bevel=0.035)
        exhaust = [(0.18, -0.05 * d, 0.28), (0.2, 0.1 * d, 0.24), (0.2, hd - 0.1, 0.34)]
        kit.tube(RIM, exhaust, [0.025, 0.03, 0.05], sides=8)
        kit.tube(DARK, [(0.08, 0.02 * d, 0.36), (0.08, yb, r)], 0.03, sides=6)
        kit.box(TYRE, (-0.07, yf - 0.12, 2 * r), (0.07, yf + 0.22, 2 * r + 0.03), bevel=0.012)
    kit.box(TAIL, (-0.06, hd - 0.05, 0.66 * h), (0.06, hd, 0.72 * h))
    kit.box(DARK, (-0.05, -0.05, 0.0), (0.05, 0.0, 0.2))
    kit.card(PLATE, [(0.1, hd - 0.02, 0.5), (-0.1, hd - 0.02, 0.5), (-0.1, hd - 0.02, 0.6), (0.1, hd - 0.02, 0.6)])
