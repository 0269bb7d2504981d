"""Cars and vans made from seeds. They look towards -Y."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, grid_triangles
from sbm_gym.assets.parametric.parts.vehicle_parts import DARK, GLASS, LAMP, PLATE, TAIL, arch, lacquer, loft, wheel


def car(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A car: saloon, estate, hatchback or off-roader."""
    w, d, h = size
    paint = lacquer(rng)
    half, front, back = 0.48 * w, -0.5 * d, 0.5 * d
    r = float(rng.uniform(0.2, 0.23)) * min(h, 1.6)
    clear, belt = 0.16 * h, float(rng.uniform(0.56, 0.62)) * h
    kind = int(rng.integers(3))
    bonnet = front + float(rng.uniform(0.24, 0.28)) * d
    tail = {0: back - 0.17 * d, 1: back - 0.03 * d, 2: back - 0.06 * d}[kind]
    nose = belt - 0.12 * h
    deck = belt - 0.02 * h if kind == 0 else belt
    loft(
        kit, paint,
        [
            (front, 0.84 * half, clear + 0.05 * h, nose - 0.07 * h), (front + 0.03 * d, 0.95 * half, clear, nose),
            (bonnet, half, clear - 0.01 * h, belt), (tail, half, clear - 0.01 * h, belt),
            (back - 0.03 * d, 0.97 * half, clear, deck), (back, 0.88 * half, clear + 0.06 * h, deck - 0.07 * h),
        ],
        0.07,
    )  # fmt: skip
    # The cabin: glass with a roof and pillars in the car's colour.
    rake_f, rake_b = float(rng.uniform(0.13, 0.17)) * d, {0: 0.13, 1: 0.05, 2: 0.1}[kind] * d
    roof0, roof1 = bonnet + rake_f, tail - rake_b
    inner, top = 0.93 * half, 0.76 * half
    y0, y1 = bonnet - 0.04 * d, tail + 0.01 * d
    base = [(-inner, y0), (inner, y0), (inner, y1), (-inner, y1)]
    roof = [(-top, roof0), (top, roof0), (top, roof1), (-top, roof1)]
    low, high = belt - 0.02, h - 0.035
    ring_low = np.array([(x, y, low) for x, y in [*base, base[0]]])
    ring_high = np.array([(x, y, high) for x, y in [*roof, roof[0]]])
    kit.add(GLASS, grid_triangles(np.stack([ring_low, ring_high], axis=1)))
    kit.box(paint, (-top - 0.02, roof0 - 0.02, high - 0.012), (top + 0.02, roof1 + 0.03, h), bevel=0.03)
    for (x0, y0), (x1, y1) in zip(base, roof, strict=True):
        kit.tube(paint, [(x0, y0, low), (x1, y1, high + 0.01)], 0.035, sides=6)
    for sx in (-1, 1):
        middle = 0.5 * (roof0 + roof1) + 0.02 * d
        for y in (middle,) if kind == 0 else (middle - 0.02 * d, middle + 0.22 * (roof1 - roof0) + 0.1 * d):
            kit.tube(paint, [(sx * inner, y, low), (sx * top, y, high)], 0.032, sides=6)
        kit.box(
            paint, (sx * half, bonnet + 0.05 * d, belt + 0.01), (sx * w / 2, bonnet + 0.1 * d, belt + 0.12), bevel=0.02
        )
        seam, handle = sx * (half + 0.002), sx * (half + 0.004)
        kit.box(DARK, (seam - 0.004, middle - 0.005, clear + 0.08), (seam + 0.004, middle + 0.005, belt - 0.03))
        kit.box(DARK, (handle - 0.008, middle + 0.05, belt - 0.12), (handle + 0.008, middle + 0.2, belt - 0.095))
        for y in (front + 0.19 * d, back - 0.2 * d):
            arch(kit, sx * half, y, r)
            wheel(kit, sx * (half + 0.01), y, r, 0.2)
        kit.box(
            LAMP,
            (sx * 0.5 * half, front + 0.005, nose - 0.14),
            (sx * 0.85 * half, front + 0.05 * d, nose - 0.03),
            bevel=0.02,
        )
        kit.box(
            TAIL,
            (sx * 0.62 * half, back - 0.03 * d, deck - 0.2),
            (sx * 0.88 * half, back - 0.003, deck - 0.08),
            bevel=0.015,
        )
    kit.box(DARK, (-0.42 * half, front - 0.002, nose - 0.16), (0.42 * half, front + 0.04, nose - 0.08))
    kit.box(DARK, (-0.8 * half, front + 0.004, clear + 0.03), (0.8 * half, front + 0.06, clear + 0.13), bevel=0.01)
    kit.box(PLATE, (-0.26, back - 0.02, clear + 0.22), (0.26, back + 0.006, clear + 0.33))


def van(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A panel van."""
    w, d, h = size
    paint = paints.plain((0.88, 0.88, 0.87), 0.5, 0.7) if rng.random() < 0.5 else lacquer(rng)
    half, front, back, r = 0.47 * w, -d / 2, d / 2, 0.34
    clear, belt, bonnet, screen = 0.24, 0.52 * h, front + 0.16 * d, front + 0.27 * d
    stations = [
        (front, 0.86 * half, clear + 0.1, belt - 0.25),
        (front + 0.03 * d, half, clear, belt - 0.16),
        (bonnet, half, clear, belt),
        (screen, half, clear, h - 0.06),
        (screen + 0.06 * d, half, clear, h),
        (back - 0.03, half, clear, h),
        (back, 0.97 * half, clear + 0.03, h - 0.04),
    ]
    loft(kit, paint, stations, 0.1)
    # The windscreen follows the slope from bonnet to roof.
    glass = 0.86 * half

    def slope(z: float) -> float:
        return bonnet + (screen - bonnet) * (z - belt) / (h - 0.06 - belt) - 0.035

    low, high = belt + 0.07, h - 0.2
    a, b = glass, 0.94 * glass
    kit.card(GLASS, [(-a, slope(low), low), (a, slope(low), low), (b, slope(high), high), (-b, slope(high), high)])
    for sx in (-1, 1):
        x = sx * (half + 0.004)
        y0, y1 = bonnet + 0.05 * d, screen + 0.12 * d
        window = [(y0, belt + 0.04), (y1, belt + 0.04), (y1, h - 0.3), (screen + 0.01 * d, h - 0.3)]
        kit.prism(GLASS, window, 0, min(x, x - sx * 0.03), max(x, x - sx * 0.03))
        kit.box(
            DARK, (sx * half, bonnet + 0.04 * d, belt + 0.05), (sx * w / 2, bonnet + 0.07 * d, belt + 0.3), bevel=0.02
        )
        kit.box(DARK, (x - 0.004, screen + 0.14 * d, clear + 0.1), (x + 0.004, screen + 0.145 * d, h - 0.2))
        for y in (front + 0.17 * d, back - 0.2 * d):
            arch(kit, sx * half, y, r)
            wheel(kit, sx * (half + 0.01), y, r, 0.22)
        kit.box(
            LAMP,
            (sx * 0.6 * half, front + 0.01, belt - 0.42),
            (sx * 0.92 * half, front + 0.12, belt - 0.26),
            bevel=0.02,
        )
        kit.box(TAIL, (sx * 0.86 * half, back - 0.04, 0.9), (sx * 0.96 * half, back + 0.004, 1.25))
    kit.box(DARK, (-0.8 * half, front + 0.01, clear + 0.1), (0.8 * half, front + 0.09, clear + 0.28), bevel=0.02)
    kit.box(PLATE, (-0.26, back - 0.02, 0.55), (0.26, back + 0.006, 0.66))
