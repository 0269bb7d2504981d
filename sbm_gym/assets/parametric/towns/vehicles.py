"""Cars, vans, lorries and buses made from seeds. They look towards -Y."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, grid_triangles, with_halves
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
    tail = back - (0.17, 0.03, 0.06)[kind] * d
    nose = belt - 0.12 * h
    deck = belt - 0.02 * h if kind == 0 else belt
    y = [front, front + 0.03 * d, bonnet, tail, back - 0.03 * d, back]
    halves = [0.84 * half, 0.95 * half, half, half, 0.97 * half, 0.88 * half]
    lows = [clear + 0.05 * h, clear, clear - 0.01 * h, clear - 0.01 * h, clear, clear + 0.06 * h]
    loft(kit, paint, y, halves, lows, [nose - 0.07 * h, nose, belt, belt, deck, deck - 0.07 * h], 0.07)
    # The cabin: glass with a roof and pillars in the car's colour.
    rake_f, rake_b = float(rng.uniform(0.13, 0.17)) * d, (0.13, 0.05, 0.1)[kind] * d
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
        outer = sx * w / 2
        kit.box(paint, (sx * half, bonnet + 0.05 * d, belt + 0.01), (outer, bonnet + 0.1 * d, belt + 0.12), 0.02)
        seam, handle = sx * (half + 0.002), sx * (half + 0.004)
        kit.box(DARK, (seam - 0.004, middle - 0.005, clear + 0.08), (seam + 0.004, middle + 0.005, belt - 0.03))
        kit.box(DARK, (handle - 0.008, middle + 0.05, belt - 0.12), (handle + 0.008, middle + 0.2, belt - 0.095))
        for y in (front + 0.19 * d, back - 0.2 * d):
            arch(kit, sx * half, y, r)
            wheel(kit, sx * (half + 0.01), y, r, 0.2)
        x0, x1 = sx * 0.5 * half, sx * 0.85 * half
        kit.box(LAMP, (x0, front + 0.005, nose - 0.14), (x1, front + 0.05 * d, nose - 0.03), bevel=0.02)
        x0, x1 = sx * 0.62 * half, sx * 0.88 * half
        kit.box(TAIL, (x0, back - 0.03 * d, deck - 0.2), (x1, back - 0.003, deck - 0.08), bevel=0.015)
    kit.box(DARK, (-0.42 * half, front - 0.002, nose - 0.16), (0.42 * half, front + 0.04, nose - 0.08))
    kit.box(DARK, (-0.8 * half, front + 0.004, clear + 0.03), (0.8 * half, front + 0.06, clear + 0.13), bevel=0.01)
    kit.box(PLATE, (-0.26, back - 0.02, clear + 0.22), (0.26, back + 0.006, clear + 0.33))


def van(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A panel van."""
    w, d, h = size
    paint = paints.plain((0.88, 0.88, 0.87), 0.5, 0.7) if rng.random() < 0.5 else lacquer(rng)
    half, front, back, r = 0.47 * w, -d / 2, d / 2, 0.34
    clear, belt, bonnet, screen = 0.24, 0.52 * h, front + 0.16 * d, front + 0.27 * d
    y = [front, front + 0.03 * d, bonnet, screen, screen + 0.06 * d, back - 0.03, back]
    halves, lows = [0.86 * half, *[half] * 5, 0.97 * half], [clear + 0.1, *[clear] * 5, clear + 0.03]
    loft(kit, paint, y, halves, lows, [belt - 0.25, belt - 0.16, belt, h - 0.06, h, h, h - 0.04], 0.1)
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
        kit.prism(GLASS, window, 0, x, x - sx * 0.03)
        outer = sx * w / 2
        kit.box(DARK, (sx * half, bonnet + 0.04 * d, belt + 0.05), (outer, bonnet + 0.07 * d, belt + 0.3), bevel=0.02)
        kit.box(DARK, (x - 0.004, screen + 0.14 * d, clear + 0.1), (x + 0.004, screen + 0.145 * d, h - 0.2))
        for y in (front + 0.17 * d, back - 0.2 * d):
            arch(kit, sx * half, y, r)
            wheel(kit, sx * (half + 0.01), y, r, 0.22)
        x0, x1 = sx * 0.6 * half, sx * 0.92 * half
        kit.box(LAMP, (x0, front + 0.01, belt - 0.42), (x1, front + 0.12, belt - 0.26), bevel=0.02)
        kit.box(TAIL, (sx * 0.86 * half, back - 0.04, 0.9), (sx * 0.96 * half, back + 0.004, 1.25))
    kit.box(DARK, (-0.8 * half, front + 0.01, clear + 0.1), (0.8 * half, front + 0.09, clear + 0.28), bevel=0.02)
    kit.box(PLATE, (-0.26, back - 0.02, 0.55), (0.26, back + 0.006, 0.66))


def truck(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lorry: a cab, and a box or an open bed behind it."""
    w, d, h, hw, _ = with_halves(size)
    cab = lacquer(rng)
    half, front, back, r = 0.48 * w, -d / 2, d / 2, 0.48
    cab_h, cab_end = min(h, 2.75) - 0.05, front + 1.9
    floor = 1.02
    kit.box(DARK, (-0.36 * w, front + 0.3, 0.5), (0.36 * w, back - 0.05, floor))
    y = [front, front + 0.03, front + 0.22, front + 0.4, cab_end]
    halves, lows, tops = [0.94 * half, *[half] * 4], [0.42, *[0.4] * 4], [1.55, 1.62, cab_h - 0.1, cab_h, cab_h]
    loft(kit, cab, y, halves, lows, tops, 0.1)
    a, b, low, high = 0.86 * half, 0.82 * half, front + 0.02, front + 0.2
    kit.card(GLASS, [(-a, low, 1.66), (a, low, 1.66), (b, high, cab_h - 0.2), (-b, high, cab_h - 0.2)])
    kit.box(DARK, (-0.7 * half, front - 0.004, 0.85), (0.7 * half, front + 0.03, 1.35))
    kit.box(DARK, (-half, front + 0.01, 0.36), (half, front + 0.2, 0.62), bevel=0.03)
    for sx in (-1, 1):
        x = sx * (half + 0.004)
        window = [(front + 0.35, 1.6), (front + 1.3, 1.6), (front + 1.3, cab_h - 0.3), (front + 0.5, cab_h - 0.3)]
        kit.prism(GLASS, window, 0, x, x - sx * 0.03)
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
    y = [front, front + 0.12, front + 0.4, back - 0.15, back]
    halves, lows = [0.93 * half, half, half, half, 0.96 * half], [0.4, 0.32, 0.32, 0.32, 0.4]
    loft(kit, paint, y, halves, lows, [h - 0.2, h - 0.05, h, h, h - 0.12], 0.12)
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
