"""What stands in streets: cars, vans, trucks, buses, two-wheelers, trees, lamps, benches. Vehicles look towards -Y."""

import colorsys
import itertools

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.seating import Size
from sbm_gym.assets.builtin_models.shapes import Kit, grid_triangles, turn_z

GLASS = paints.plain((0.06, 0.08, 0.09), 0.9, 0.9)
TYRE = paints.plain((0.035, 0.035, 0.037), 0.05)
RIM = paints.plain((0.62, 0.63, 0.65), 0.7, 0.7)
DARK = paints.plain((0.08, 0.08, 0.085), 0.2)
LAMP = paints.plain((0.92, 0.93, 0.95), 0.8, 0.8)
TAIL = paints.plain((0.6, 0.03, 0.03), 0.5, 0.6)
PLATE = paints.plain((0.9, 0.9, 0.88), 0.1)


def lacquer(rng: np.random.Generator) -> paints.Paint:
    """Car paint: white, grey, silver and black more often than colours."""
    if rng.random() < 0.6:
        value = float(rng.choice([0.04, 0.12, 0.3, 0.55, 0.75, 0.9]))
        return paints.plain((value, value, value), 0.7, 0.8)
    hue = float(rng.choice([0.0, 0.02, 0.08, 0.13, 0.35, 0.55, 0.6, 0.63]))
    rgb = colorsys.hsv_to_rgb(hue, float(rng.uniform(0.55, 0.9)), float(rng.uniform(0.3, 0.75)))
    return paints.plain(rgb, 0.7, 0.8)


def _loft(kit: Kit, paint: paints.Paint, stations: list[tuple[float, float, float, float]], bevel: float) -> None:
    """A closed body along Y through cross sections (y, half width, bottom, top) with softened edges."""
    rings = []
    for y, half, low, high in stations:
        b = min(bevel, 0.45 * half, 0.45 * (high - low))
        ring = [
            (-half, low + b), (-half, high - b), (-half + b, high), (half - b, high),
            (half, high - b), (half, low + b), (half - b, low), (-half + b, low), (-half, low + b),
        ]  # fmt: skip
        rings.append([(x, y, z) for x, z in ring])
    points = np.array(rings, float).swapaxes(0, 1)
    fan = np.arange(1, 7)
    first, last = points[:8, 0], points[:8, -1]
    caps = [
        np.stack([last[np.zeros(6, int)], last[fan], last[fan + 1]], axis=1),
        np.stack([first[np.zeros(6, int)], first[fan + 1], first[fan]], axis=1),
    ]
    kit.add(paint, np.concatenate([grid_triangles(points), *caps]), crease_rad=np.deg2rad(35))


def _wheel(kit: Kit, x: float, y: float, r: float, wide: float) -> None:
    """A wheel whose outer face is at x, away from the middle."""
    side = np.sign(x)
    angle = np.arange(18) * 2 * np.pi / 18

    def disc(paint: paints.Paint, radius: float, a: float, b: float) -> None:
        low, high = sorted((a, b))
        kit.prism(paint, [(y + radius * np.cos(t), r + radius * np.sin(t)) for t in angle], 0, low, high)

    disc(TYRE, r, x, x - side * wide)
    disc(RIM, 0.62 * r, x + side * 0.006, x - side * 0.02)
    disc(DARK, 0.16 * r, x + side * 0.012, x)


def _arch(kit: Kit, x: float, y: float, r: float) -> None:
    """The dark opening of a wheel house."""
    side = np.sign(x)
    outline = [(y + 1.16 * r * np.cos(t), r + 1.16 * r * np.sin(t)) for t in np.linspace(-0.2, np.pi + 0.2, 14)]
    low, high = sorted((x - side * 0.12, x + side * 0.003))
    kit.prism(DARK, outline, 0, low, high)


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
    _loft(
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
    base = [
        (-inner, bonnet - 0.04 * d),
        (inner, bonnet - 0.04 * d),
        (inner, tail + 0.01 * d),
        (-inner, tail + 0.01 * d),
    ]
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
        kit.box(
            DARK,
            (sx * (half + 0.002) - 0.004, middle - 0.005, clear + 0.08),
            (sx * (half + 0.002) + 0.004, middle + 0.005, belt - 0.03),
        )
        kit.box(
            DARK,
            (sx * (half + 0.004) - 0.008, middle + 0.05, belt - 0.12),
            (sx * (half + 0.004) + 0.008, middle + 0.2, belt - 0.095),
        )
        for y in (front + 0.19 * d, back - 0.2 * d):
            _arch(kit, sx * half, y, r)
            _wheel(kit, sx * (half + 0.01), y, r, 0.2)
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
    _loft(kit, paint, stations, 0.1)
    # The windscreen follows the slope from bonnet to roof.
    glass = 0.86 * half

    def slope(z: float) -> float:
        return bonnet + (screen - bonnet) * (z - belt) / (h - 0.06 - belt) - 0.035

    low, high = belt + 0.07, h - 0.2
    kit.card(
        GLASS,
        [
            (-glass, slope(low), low),
            (glass, slope(low), low),
            (0.94 * glass, slope(high), high),
            (-0.94 * glass, slope(high), high),
        ],
    )
    for sx in (-1, 1):
        x = sx * (half + 0.004)
        kit.prism(
            GLASS,
            [
                (bonnet + 0.05 * d, belt + 0.04),
                (screen + 0.12 * d, belt + 0.04),
                (screen + 0.12 * d, h - 0.3),
                (screen + 0.01 * d, h - 0.3),
            ],
            0,
            min(x, x - sx * 0.03),
            max(x, x - sx * 0.03),
        )
        kit.box(
            DARK, (sx * half, bonnet + 0.04 * d, belt + 0.05), (sx * w / 2, bonnet + 0.07 * d, belt + 0.3), bevel=0.02
        )
        kit.box(DARK, (x - 0.004, screen + 0.14 * d, clear + 0.1), (x + 0.004, screen + 0.145 * d, h - 0.2))
        for y in (front + 0.17 * d, back - 0.2 * d):
            _arch(kit, sx * half, y, r)
            _wheel(kit, sx * (half + 0.01), y, r, 0.22)
        kit.box(
            LAMP,
            (sx * 0.6 * half, front + 0.01, belt - 0.42),
            (sx * 0.92 * half, front + 0.12, belt - 0.26),
            bevel=0.02,
        )
        kit.box(TAIL, (sx * 0.86 * half, back - 0.04, 0.9), (sx * 0.96 * half, back + 0.004, 1.25))
    kit.box(DARK, (-0.8 * half, front + 0.01, clear + 0.1), (0.8 * half, front + 0.09, clear + 0.28), bevel=0.02)
    kit.box(PLATE, (-0.26, back - 0.02, 0.55), (0.26, back + 0.006, 0.66))


def truck(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lorry: a cab, and a box or an open bed behind it."""
    w, d, h = size
    cab = lacquer(rng)
    half, front, back, r = 0.48 * w, -d / 2, d / 2, 0.48
    cab_h, cab_end = min(h, 2.75) - 0.05, front + 1.9
    floor = 1.02
    kit.box(DARK, (-0.36 * w, front + 0.3, 0.5), (0.36 * w, back - 0.05, floor))
    _loft(
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
    kit.card(
        GLASS,
        [
            (-0.86 * half, front + 0.02, 1.66),
            (0.86 * half, front + 0.02, 1.66),
            (0.82 * half, front + 0.2, cab_h - 0.2),
            (-0.82 * half, front + 0.2, cab_h - 0.2),
        ],
    )
    kit.box(DARK, (-0.7 * half, front - 0.004, 0.85), (0.7 * half, front + 0.03, 1.35))
    kit.box(DARK, (-half, front + 0.01, 0.36), (half, front + 0.2, 0.62), bevel=0.03)
    for sx in (-1, 1):
        x = sx * (half + 0.004)
        kit.prism(
            GLASS,
            [(front + 0.35, 1.6), (front + 1.3, 1.6), (front + 1.3, cab_h - 0.3), (front + 0.5, cab_h - 0.3)],
            0,
            min(x, x - sx * 0.03),
            max(x, x - sx * 0.03),
        )
        kit.box(DARK, (sx * half, front + 0.2, 1.6), (sx * w / 2, front + 0.3, 2.1), bevel=0.02)
        kit.box(LAMP, (sx * 0.6 * half, front - 0.002, 0.66), (sx * 0.9 * half, front + 0.1, 0.82))
        wheels = [front + 0.95, back - 0.22 * d] + ([back - 0.22 * d + 1.15] if d > 7.5 else [])
        for y in wheels:
            _wheel(kit, sx * half, y, r, 0.3)
        kit.box(TAIL, (sx * 0.7 * half, back - 0.06, 0.75), (sx * 0.95 * half, back, 0.92))
    load = lacquer(rng) if rng.random() < 0.5 else paints.plain((0.86, 0.86, 0.84), 0.2)
    if rng.random() < 0.65:
        kit.box(load, (-w / 2 + 0.02, cab_end + 0.12, floor), (w / 2 - 0.02, back, h), bevel=0.03)
        kit.box(DARK, (-0.004, back - 0.01, floor + 0.1), (0.004, back + 0.003, h - 0.1))
    else:
        kit.box(load, (-w / 2 + 0.02, cab_end + 0.12, floor), (w / 2 - 0.02, back, floor + 0.12))
        side = floor + 0.7
        kit.box(load, (-w / 2 + 0.02, cab_end + 0.12, floor), (w / 2 - 0.02, cab_end + 0.2, h))
        kit.box(load, (-w / 2 + 0.02, back - 0.08, floor), (w / 2 - 0.02, back, side))
        for sx in (-1, 1):
            kit.box(load, (sx * (w / 2 - 0.02), cab_end + 0.12, floor), (sx * (w / 2 - 0.1), back, side))


def bus(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A city bus."""
    w, d, h = size
    paint = lacquer(rng)
    half, front, back, r = 0.47 * w, -d / 2, d / 2, 0.48
    _loft(
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
        a, b = min(x, x - sx * 0.04), max(x, x - sx * 0.04)
        kit.box(GLASS, (a, front + 0.5, low), (b, back - 0.6, high))
        kit.box(band, (a, front + 0.3, 0.72), (b, back - 0.3, 0.95))
        for y in np.arange(front + 1.9, back - 1.0, 1.5):
            kit.box(paint, (a - 0.003, y - 0.05, low), (b + 0.003, y + 0.05, high))
        for y in (front + 0.24 * d, back - 0.25 * d):
            _arch(kit, sx * half, y, r)
            _wheel(kit, sx * (half + 0.012), y, r, 0.3)
        kit.box(LAMP, (sx * 0.6 * half, front - 0.004, 0.62), (sx * 0.88 * half, front + 0.05, 0.8))
        kit.box(TAIL, (sx * 0.75 * half, back - 0.03, 0.7), (sx * 0.9 * half, back + 0.004, 1.1))
        kit.box(DARK, (sx * half, front + 0.05, h - 1.2), (sx * w / 2, front + 0.15, h - 0.75), bevel=0.02)
    for y in (front + 0.55, front + 0.5 * d):  # doors on the right, seen from the driver's seat
        kit.box(DARK, (-half - 0.012, y, 0.42), (-half + 0.02, y + 1.15, high + 0.08))
        for k in (0.06, 0.6):
            kit.box(GLASS, (-half - 0.016, y + k, 0.55), (-half, y + k + 0.49, high))
    kit.box(GLASS, (-0.86 * half, front - 0.006, 1.05), (0.86 * half, front + 0.04, h - 0.6))
    kit.box(
        paints.plain((0.95, 0.6, 0.1), 0.2), (-0.5 * half, front - 0.004, h - 0.5), (0.5 * half, front + 0.04, h - 0.28)
    )
    kit.box(GLASS, (-0.8 * half, back - 0.03, 1.5), (0.8 * half, back + 0.004, h - 0.6))


def _spoked(kit: Kit, y: float, r: float, tyre: float, spokes: int) -> None:
    angle = np.linspace(0, 2 * np.pi, 25)
    kit.tube(TYRE, [(0, y + (r - tyre) * np.cos(a), r + (r - tyre) * np.sin(a)) for a in angle], tyre, sides=6)
    for a in np.arange(spokes) * 2 * np.pi / spokes:
        kit.tube(
            RIM,
            [(0, y, r), (0, y + (r - tyre) * np.cos(a), r + (r - tyre) * np.sin(a))],
            0.004 if spokes > 6 else 0.015,
            sides=4,
        )


def bicycle(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bicycle."""
    w, d, h = size
    frame = lacquer(rng)
    r = min(0.345, 0.34 * h)
    yf, yb = -d / 2 + r, d / 2 - r
    _spoked(kit, yf, r, 0.018, 12)
    _spoked(kit, yb, r, 0.018, 12)
    crank, seat, head = (0, 0.06 * d, 0.29), (0, 0.14 * d, 0.82 * h), (0, yf + 0.17, 0.83 * h)
    neck = (0, yf + 0.12, 0.66 * h)
    low = float(rng.uniform(0.25, 0.9))
    top = tuple(np.array(crank) + low * (np.array(seat) - np.array(crank)) * 0.95)
    for a, b in ((crank, seat), (crank, neck), (top, head), (crank, (0, yb, r)), (top, (0, yb, r)), (head, (0, yf, r))):
        kit.tube(frame, [a, b], 0.019, sides=7)
    kit.tube(
        DARK,
        [
            (-w / 2, yf + 0.3, 0.97 * h),
            (-0.4 * w, yf + 0.16, 0.985 * h),
            (0, yf + 0.16, 0.95 * h),
            (0.4 * w, yf + 0.16, 0.985 * h),
            (w / 2, yf + 0.3, 0.97 * h),
        ],
        0.014,
        sides=6,
    )
    kit.tube(frame, [head, (0, yf + 0.16, 0.95 * h)], 0.015, sides=6)
    kit.tube(RIM, [seat, (0, 0.15 * d, 0.88 * h)], 0.013, sides=6)
    kit.box(DARK, (-0.07, 0.09 * d, 0.88 * h), (0.07, 0.09 * d + 0.26, 0.92 * h), bevel=0.018)
    kit.prism(
        DARK,
        [(crank[1] + 0.09 * np.cos(a), 0.29 + 0.09 * np.sin(a)) for a in np.arange(12) * np.pi / 6],
        0,
        0.025,
        0.035,
    )
    for sx, way in ((-1, 1), (1, -1)):
        kit.tube(
            RIM, [(sx * 0.05, crank[1], 0.29), (sx * 0.06, crank[1] + way * 0.05, 0.29 - way * 0.16)], 0.01, sides=5
        )
        kit.box(
            DARK,
            (sx * 0.06, crank[1] + way * 0.05 - 0.04, 0.28 - way * 0.16),
            (sx * 0.15, crank[1] + way * 0.05 + 0.04, 0.3 - way * 0.16),
        )
    if rng.random() < 0.4:
        kit.box(DARK, (-0.07, yb - 0.25, 2 * r + 0.03), (0.07, yb + 0.15, 2 * r + 0.045))


def motorcycle(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A motorcycle or scooter."""
    w, d, h = size
    paint = lacquer(rng)
    scooter = rng.random() < 0.4
    r = 0.22 if scooter else 0.31
    yf, yb = -d / 2 + r, d / 2 - r - 0.03
    for y in (yf, yb):
        for sx in (-1, 1):
            _wheel(kit, sx * 0.06, y, r, 0.06)
    kit.tube(RIM, [(0, yf, r), (0, yf + 0.28, 0.82 * h)], 0.03, sides=7)
    kit.tube(
        DARK,
        [
            (-w / 2, yf + 0.42, 0.86 * h),
            (-0.3 * w, yf + 0.28, 0.9 * h),
            (0.3 * w, yf + 0.28, 0.9 * h),
            (w / 2, yf + 0.42, 0.86 * h),
        ],
        0.018,
        sides=6,
    )
    kit.box(LAMP, (-0.08, yf + 0.14, 0.72 * h), (0.08, yf + 0.24, 0.72 * h + 0.15), bevel=0.03)
    seat = 0.66 * h
    if scooter:
        kit.box(paint, (-0.2, yf + 0.26, 0.3), (0.2, yf + 0.34, 0.8 * h), bevel=0.03)
        kit.box(paint, (-0.17, yf + 0.3, 0.2), (0.17, yb, 0.32), bevel=0.03)
        _loft(
            kit,
            paint,
            [(0.02 * d, 0.14, 0.28, seat - 0.06), (0.2 * d, 0.18, 0.3, seat), (d / 2 - 0.06, 0.1, 0.42, seat + 0.02)],
            0.05,
        )
        kit.box(DARK, (-0.14, 0.02 * d, seat - 0.03), (0.14, d / 2 - 0.1, seat + 0.06), bevel=0.035)
        if rng.random() < 0.4:
            kit.box(DARK, (-0.18, d / 2 - 0.3, seat + 0.06), (0.18, d / 2, seat + 0.36), bevel=0.05)
    else:
        kit.box(DARK, (-0.17, -0.13 * d, 0.26), (0.17, 0.1 * d, 0.5), bevel=0.05)
        for z in np.linspace(0.3, 0.48, 4):
            kit.box(RIM, (-0.2, -0.1 * d, z), (0.2, 0.05 * d, z + 0.015))
        _loft(
            kit,
            paint,
            [
                (-0.22 * d, 0.1, 0.58 * h, 0.74 * h),
                (-0.1 * d, 0.16, 0.52 * h, 0.84 * h),
                (0.08 * d, 0.11, 0.54 * h, 0.72 * h),
            ],
            0.06,
        )
        _loft(
            kit,
            paint,
            [
                (0.06 * d, 0.1, 0.52 * h, 0.66 * h),
                (0.3 * d, 0.12, 0.56 * h, 0.7 * h),
                (d / 2 - 0.04, 0.06, 0.66 * h, 0.74 * h),
            ],
            0.04,
        )
        kit.box(DARK, (-0.12, 0.04 * d, 0.66 * h), (0.12, 0.36 * d, 0.74 * h), bevel=0.035)
        kit.tube(
            RIM, [(0.18, -0.05 * d, 0.28), (0.2, 0.1 * d, 0.24), (0.2, d / 2 - 0.1, 0.34)], [0.025, 0.03, 0.05], sides=8
        )
        kit.tube(DARK, [(0.08, 0.02 * d, 0.36), (0.08, yb, r)], 0.03, sides=6)
        kit.box(TYRE, (-0.07, yf - 0.12, 2 * r), (0.07, yf + 0.22, 2 * r + 0.03), bevel=0.012)
    kit.box(TAIL, (-0.06, d / 2 - 0.05, 0.66 * h), (0.06, d / 2, 0.72 * h))
    kit.box(DARK, (-0.05, -0.05, 0.0), (0.05, 0.0, 0.2))
    kit.card(
        PLATE,
        [(0.1, d / 2 - 0.02, 0.5), (-0.1, d / 2 - 0.02, 0.5), (-0.1, d / 2 - 0.02, 0.6), (0.1, d / 2 - 0.02, 0.6)],
    )


def tree(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A tree: a trunk with branches and a crown of leaf clusters, round, tall or in tiers."""
    w, _, h = size
    bark = paints.plain((0.30, 0.23, 0.17), 0.0)
    green = paints.leaf(rng)
    greens = [green, paints.darker(green, 0.75), paints.darker(green, 1.25)]
    conifer = rng.random() < 0.2
    bare = (0.08 if conifer else float(rng.uniform(0.24, 0.36))) * h
    kit.tube(
        bark,
        [(0, 0, 0), (0.02 * w, 0, bare), (0, 0.01 * w, 0.85 * h)],
        [0.05 * h**0.8, 0.035 * h**0.8, 0.01 * h],
        sides=8,
    )
    for i in range(9):
        a, z = i * 2.4, bare + (0.7 * h - bare) * i / 9
        out = 0.36 * w * (1 - 0.5 * i / 9)
        if not conifer:
            kit.tube(
                bark,
                [(0, 0, z), (out * np.cos(a), out * np.sin(a), z + 0.16 * h)],
                [0.018 * h**0.8, 0.006 * h],
                sides=5,
            )
    count = 260
    for i in range(count):
        t = (i + 0.5) / count
        a = i * 2.39996 + rng.normal(0, 0.2)
        if conifer:
            z = bare + (h - bare) * t**0.8
            out = 0.5 * w * (1 - (z - bare) / (h - bare)) * np.sqrt(rng.uniform(0.35, 1.0)) + 0.02 * w
            rise = rng.uniform(-0.6, 0.0)
        else:
            lift = 2 * t - 1  # even over a ball
            shell = rng.uniform(0.62, 1.0) ** 0.5
            z = bare + 0.5 * (h - bare) * (1 + 0.97 * lift * shell)
            out = 0.46 * w * np.sqrt(max(1 - lift**2, 0.02)) * shell * (1 + 0.12 * np.sin(3 * a))
            rise = rng.uniform(-0.5, 0.6)
        length = float(rng.uniform(0.13, 0.2)) * w
        kit.leaf(
            greens[rng.integers(3)],
            (out * np.cos(a), out * np.sin(a), z),
            a + rng.normal(0, 0.8),
            length,
            0.8 * length,
            rise,
            0.7,
            2,
        )


def street_light(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A street lamp: a mast with an arm, or a lantern on a post."""
    w, d, h = size
    post = paints.plain(((0.1, 0.11, 0.1), (0.5, 0.51, 0.52), (0.12, 0.2, 0.16))[rng.integers(3)], 0.4)
    glow = paints.plain((1.0, 0.96, 0.85), 0.2)
    if h > 4.5:
        y = d / 2 - 0.12
        kit.lathe(post, [(0, 0), (0.12, 0), (0.12, 0.25), (0.07, 0.35), (0.045, h - 0.5), (0, h - 0.5)], (0, y), 10)
        kit.tube(
            post,
            [(0, y, h - 0.55), (0, y - 0.1, h - 0.15), (0, 0, h - 0.05), (0, -d / 2 + 0.4, h - 0.05)],
            0.035,
            sides=7,
        )
        kit.box(post, (-0.12, -d / 2, h - 0.09), (0.12, -d / 2 + 0.5, h), bevel=0.03)
        kit.box(glow, (-0.09, -d / 2 + 0.05, h - 0.105), (0.09, -d / 2 + 0.45, h - 0.08))
        return
    r = 0.5 * min(w, d)
    kit.lathe(
        post,
        [
            (0, 0),
            (0.7 * r, 0),
            (0.7 * r, 0.15),
            (0.35 * r, 0.4),
            (0.2 * r, 0.5),
            (0.17 * r, h - 0.75),
            (0.35 * r, h - 0.68),
            (0, h - 0.68),
        ],
        sides=12,
    )
    kit.lathe(glow, [(0.5 * r, h - 0.68), (0.9 * r, h - 0.25), (0, h - 0.25)], sides=6)
    kit.lathe(post, [(r, h - 0.26), (0.95 * r, h - 0.22), (0.2 * r, h - 0.05), (0.1 * r, h), (0, h)], sides=6)


def bench(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A park bench with slats."""
    w, d, h = size
    slat = paints.wood(rng) if rng.random() < 0.75 else lacquer(rng)
    iron = paints.plain((0.09, 0.1, 0.1), 0.3)
    seat = 0.44
    for x in (-0.42 * w, 0.42 * w):
        kit.tube(
            iron,
            [
                (x, -d / 2 + 0.04, 0),
                (x, -d / 2 + 0.08, seat - 0.02),
                (x, d / 2 - 0.18, seat - 0.05),
                (x, d / 2 - 0.03, h - 0.02),
            ],
            0.022,
            sides=6,
        )
        kit.tube(iron, [(x, d / 2 - 0.05, 0), (x, d / 2 - 0.18, seat - 0.05)], 0.022, sides=6)
        kit.tube(
            iron,
            [(x, -d / 2 + 0.06, 0.2), (x, -d / 2 + 0.05, seat + 0.2), (x, d / 2 - 0.1, seat + 0.2)],
            0.018,
            sides=6,
        )
    for y in np.linspace(-d / 2 + 0.07, d / 2 - 0.2, 4):
        kit.box(slat, (-w / 2, y - 0.045, seat - 0.02), (w / 2, y + 0.045, seat + 0.012), bevel=0.006)
    for t in np.linspace(0.3, 1.0, 3):
        y, z = d / 2 - 0.2 + 0.15 * t, seat + t * (h - seat) - 0.05
        kit.box(slat, (-w / 2, y - 0.02, z - 0.045), (w / 2, y + 0.012, z + 0.045), bevel=0.006)


def litter_bin(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A litter bin of slats around a drum."""
    w, _, h = size
    r = w / 2
    paint = lacquer(rng)
    kit.lathe(
        DARK,
        [(0, 0), (0.85 * r, 0), (0.85 * r, 0.95 * h), (0.7 * r, 0.95 * h), (0.7 * r, 0.5 * h), (0, 0.5 * h)],
        sides=14,
    )
    for a in np.arange(14) * 2 * np.pi / 14:
        with kit.placed(rotation=turn_z(float(a))):
            kit.box(paint, (-0.16 * r, -0.97 * r, 0.06 * h), (0.16 * r, -0.86 * r, 0.94 * h))
    kit.lathe(
        paint,
        [(0.84 * r, 0.94 * h), (r, 0.94 * h), (r, h), (0.75 * r, h), (0.75 * r, 0.94 * h), (0.84 * r, 0.94 * h)],
        sides=20,
    )


def traffic_cone(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A traffic cone."""
    w, _, h = size
    orange = paints.plain((0.92, 0.3 + 0.08 * float(rng.random()), 0.05), 0.2)
    white = paints.plain((0.93, 0.93, 0.92), 0.2)
    kit.box(orange if rng.random() < 0.6 else DARK, (-w / 2, -w / 2, 0), (w / 2, w / 2, 0.035), bevel=0.008)
    foot, tip = 0.38 * w, 0.08 * w
    levels = [0.035, 0.35 * h, 0.52 * h, 0.68 * h, 0.82 * h, h]
    for number, (a, b) in enumerate(itertools.pairwise(levels)):
        r0, r1 = (foot + (tip - foot) * (z - 0.035) / (h - 0.035) for z in (a, b))
        kit.lathe(white if number in (1, 3) else orange, [(r0, a), (r1, b), *([(0.0, h)] if b == h else [])], sides=18)


def cafe_chair(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A light chair of metal and slats."""
    w, d, h = size
    metal, slat = paints.metal(rng), paints.wood(rng) if rng.random() < 0.6 else lacquer(rng)
    seat = 0.45
    for sx in (-1, 1):
        x = sx * (w / 2 - 0.015)
        kit.tube(metal, [(x, -d / 2 + 0.02, 0), (x, -d / 2 + 0.05, seat)], 0.012, sides=6)
        kit.tube(metal, [(x, d / 2 - 0.02, 0), (x, d / 2 - 0.09, seat), (x, d / 2 - 0.015, h)], 0.012, sides=6)
    for y in np.linspace(-d / 2 + 0.05, d / 2 - 0.12, 5):
        kit.box(slat, (-w / 2, y - 0.03, seat - 0.01), (w / 2, y + 0.03, seat + 0.012))
    for z in np.linspace(seat + 0.18, h - 0.04, 3):
        y = d / 2 - 0.09 + 0.075 * (z - seat) / (h - seat)
        kit.box(slat, (-w / 2, y - 0.02, z - 0.03), (w / 2, y + 0.004, z + 0.03))


def cafe_table(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A small round table on one leg."""
    w, _, h = size
    metal = paints.metal(rng)
    top = paints.wood(rng) if rng.random() < 0.5 else paints.board(rng)
    kit.lathe(
        metal, [(0, 0), (0.34 * w, 0), (0.34 * w, 0.015), (0.03, 0.05), (0.025, h - 0.03), (0, h - 0.03)], sides=16
    )
    kit.lathe(top, [(0, h - 0.03), (w / 2, h - 0.03), (w / 2, h), (0, h)], sides=24)


def parasol(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A parasol on a foot."""
    w, _, h = size
    cloth = paints.fabric(rng, 0.3)
    post = paints.wood(rng)
    kit.lathe(DARK, [(0, 0), (0.25, 0), (0.25, 0.06), (0.05, 0.1), (0, 0.1)], sides=14)
    kit.tube(post, [(0, 0, 0.05), (0, 0, h)], 0.022, sides=8)
    rim = h - 0.16 * w
    kit.lathe(cloth, [(w / 2, rim - 0.14), (w / 2, rim), (0, h - 0.02)], sides=8)
    kit.lathe(paints.darker(cloth, 0.8), [(0, h - 0.03), (0.495 * w, rim - 0.005), (0.495 * w, rim - 0.14)], sides=8)


def fountain(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A round fountain with a basin and a bowl."""
    w, _, h = size
    stone = paints.plain(tuple(float(c) for c in np.array([0.62, 0.6, 0.56]) * rng.uniform(0.85, 1.1)), 0.05)
    water = paints.plain((0.2, 0.36, 0.42), 0.9, 0.9)
    r, rim = w / 2, 0.24 * h
    kit.lathe(stone, [(0, 0), (r, 0), (r, rim), (0.88 * r, rim), (0.86 * r, 0.5 * rim), (0, 0.5 * rim)], sides=28)
    kit.lathe(water, [(0.87 * r, 0.85 * rim), (0, 0.85 * rim)], sides=28)
    kit.lathe(
        stone,
        [
            (0.24 * r, 0.5 * rim),
            (0.12 * r, 0.35 * h),
            (0.1 * r, 0.6 * h),
            (0.45 * r, 0.74 * h),
            (0.42 * r, 0.75 * h),
            (0.12 * r, 0.68 * h),
            (0.06 * r, 0.9 * h),
            (0.09 * r, h),
            (0, h),
        ],
        sides=20,
    )
    kit.lathe(water, [(0.4 * r, 0.735 * h), (0.1 * r, 0.735 * h)], sides=20)
