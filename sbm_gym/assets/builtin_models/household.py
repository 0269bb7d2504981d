"""Fridges, toilets, televisions, lamps, plants and small things."""

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.seating import Size
from sbm_gym.assets.builtin_models.shapes import Kit, turn_x, turn_z

BLACK = paints.plain((0.035, 0.035, 0.04), 0.5, 0.7)
SCREEN = paints.plain((0.03, 0.032, 0.037), 0.9, 0.9)
CERAMIC = paints.plain((0.93, 0.93, 0.92), 0.6, 0.7)
CHROME = paints.plain((0.72, 0.73, 0.75), 0.9, 0.8)


def fridge(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A fridge: freezer above, below or beside, or one door; white, steel, black or a colour."""
    w, d, h = size
    tones = (
        (0.93, 0.93, 0.93),
        (0.93, 0.93, 0.93),
        (0.66, 0.67, 0.69),
        (0.66, 0.67, 0.69),
        (0.93, 0.93, 0.93),
        (0.66, 0.67, 0.69),
        (0.09, 0.09, 0.1),
        (0.62, 0.16, 0.14),
        (0.62, 0.78, 0.74),
        (0.88, 0.82, 0.66),
    )
    tone = tones[rng.integers(len(tones))]
    body = paints.plain(tone, 0.35, 0.6)
    seal = paints.plain((0.18, 0.18, 0.18), 0.0)
    front = -d / 2 + 0.035
    door = front + 0.055
    bevel = float(rng.choice([0.012, 0.012, 0.05]))
    kit.box(body, (-w / 2, door + 0.012, 0.03), (w / 2, d / 2, h), bevel=0.008)
    kit.box(seal, (-w / 2 + 0.012, door, 0.04), (w / 2 - 0.012, door + 0.02, h - 0.012))
    kit.box(seal, (-w / 2 + 0.02, door + 0.02, 0), (w / 2 - 0.02, d / 2 - 0.03, 0.05))
    kind = 3 if w > 0.8 else int(rng.integers(3)) if h > 1.1 else 0
    split = h * float(rng.uniform(0.66, 0.74)) if kind == 1 else h * float(rng.uniform(0.32, 0.42))
    low = 0.05
    panels = {
        0: [(-w / 2, w / 2, low, h)],
        1: [(-w / 2, w / 2, low, split), (-w / 2, w / 2, split, h)],
        2: [(-w / 2, w / 2, low, split), (-w / 2, w / 2, split, h)],
        3: [(-w / 2, 0.0, low, h), (0.0, w / 2, low, h)],
    }[kind]
    grip = CHROME if rng.random() < 0.7 else BLACK
    side = int(rng.choice([-1, 1]))
    for number, (x0, x1, z0, z1) in enumerate(panels):
        kit.box(
            body,
            (x0 + 0.002, front, z0 + 0.004),
            (x1 - 0.002, door, z1 - 0.003),
            bevel=bevel,
            puff=0.006 if bevel > 0.02 else 0,
        )
        if kind == 3:
            x = -0.045 if number == 0 else 0.045
            a, b = 0.45 * h, 0.72 * h
        else:
            x = side * (w / 2 - 0.055)
            lower = number == 0 and len(panels) == 2
            length = min(0.4, 0.6 * (z1 - z0))
            a, b = (z1 - 0.06 - length, z1 - 0.06) if lower else (z0 + 0.06, z0 + 0.06 + length)
            if len(panels) == 1:
                a, b = 0.5 * h, 0.5 * h + length
        kit.tube(grip, [(x, front - 0.028, a), (x, front - 0.028, b)], 0.011, sides=8)
        for z in (a + 0.03, b - 0.03):
            kit.tube(grip, [(x, front + 0.01, z), (x, front - 0.028, z)], 0.008, sides=6)
    if kind == 3 and rng.random() < 0.6:
        kit.box(BLACK, (-0.34 * w, front - 0.008, 0.52 * h), (-0.14 * w, front + 0.004, 0.68 * h), bevel=0.004)
    if rng.random() < 0.4:
        for _ in range(int(rng.integers(2, 6))):  # notes and magnets
            x, z = rng.uniform(-0.3, 0.2) * w, rng.uniform(0.6, 0.85) * h
            s = rng.uniform(0.03, 0.09)
            kit.box(
                paints.plain(tuple(rng.uniform(0.3, 1.0, 3)), 0.0), (x, front - 0.004, z), (x + s, front + 0.004, z + s)
            )


def toilet(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A toilet: an oval bowl with seat and lid, and a cistern behind it."""
    w, d, h = size
    rim = float(np.clip(rng.uniform(0.38, 0.43), 0.3, h - 0.25))
    tank_d = float(rng.uniform(0.15, 0.19))
    bowl_d = d - tank_d
    bowl_w = min(w, 0.38)
    middle = -d / 2 + bowl_d / 2 + 0.01
    skirted = rng.random() < 0.5

    def egg(points: np.ndarray) -> np.ndarray:
        stretched = points * [bowl_w / 2, bowl_d / 2, 1.0]
        # The back half is squarer than the front.
        return stretched + np.stack(
            [
                np.where(points[:, 1] > 0, 0.12 * stretched[:, 0] * points[:, 1] ** 2, 0.0),
                0 * points[:, 0],
                0 * points[:, 0],
            ],
            axis=1,
        )

    foot = 0.72 if skirted else 0.52
    with kit.placed((0, 0.02 if not skirted else 0, 0)):
        kit.lathe(
            CERAMIC,
            [
                (0, 0),
                (foot, 0),
                (foot * 0.96, 0.06),
                (foot * (0.98 if skirted else 0.8), 0.2),
                (0.9, rim - 0.1),
                (0.98, rim - 0.03),
                (0.98, rim),
                (0.78, rim),
                (0.6, rim - 0.08),
                (0.3, rim - 0.16),
                (0, rim - 0.17),
            ],
            (0, middle),
            22,
            egg,
        )
    lid_up = rng.random() < 0.35
    seat_tone = CERAMIC if rng.random() < 0.85 else paints.wood(rng)
    kit.lathe(
        seat_tone,
        [
            (0.70, rim),
            (1.0, rim),
            (1.02, rim + 0.012),
            (0.98, rim + 0.024),
            (0.72, rim + 0.024),
            (0.66, rim + 0.012),
            (0.70, rim),
        ],
        (0, middle),
        22,
        egg,
    )
    if lid_up:
        with kit.placed((0, d / 2 - tank_d - 0.03, rim + 0.03), turn_x(np.pi / 2 - 0.12)):
            kit.lathe(
                seat_tone,
                [(0, 0), (1.0, 0), (1.0, 0.016), (0, 0.022)],
                (0, bowl_d / 2 - 0.02),
                22,
                lambda p: p * [bowl_w / 2, -(bowl_d / 2 - 0.04), 1.0] * [-1, 1, 1],
            )
    else:
        kit.lathe(
            seat_tone,
            [(0, rim + 0.024), (1.0, rim + 0.024), (1.0, rim + 0.038), (0.9, rim + 0.046), (0, rim + 0.05)],
            (0, middle),
            22,
            egg,
        )
    kit.box(
        CERAMIC,
        (-0.45 * bowl_w, middle + 0.2 * bowl_d, 0.0 if skirted else rim - 0.2),
        (0.45 * bowl_w, d / 2 - 0.02, rim - 0.01),
        bevel=0.03,
    )
    tank_w = min(w, float(rng.uniform(0.34, 0.44)))
    kit.box(CERAMIC, (-tank_w / 2, d / 2 - tank_d, rim - 0.02), (tank_w / 2, d / 2, h - 0.03), bevel=0.025)
    kit.box(
        CERAMIC,
        (-tank_w / 2 - 0.005, d / 2 - tank_d - 0.006, h - 0.04),
        (tank_w / 2 + 0.005, d / 2, h - 0.006),
        bevel=0.012,
    )
    kit.lathe(CHROME, [(0, h - 0.006), (0.022, h - 0.006), (0.02, h), (0, h)], (0, d / 2 - tank_d / 2), 12)


def _screen(kit: Kit, rng, w: float, low: float, h: float, y: float, thick: float) -> None:
    frame = BLACK if rng.random() < 0.8 else CHROME
    edge = float(rng.uniform(0.008, 0.02))
    kit.box(frame, (-w / 2, y - thick / 2, low), (w / 2, y + thick / 2, h), bevel=0.004)
    kit.box(
        SCREEN,
        (-w / 2 + edge, y - thick / 2 - 0.001, low + 1.6 * edge),
        (w / 2 - edge, y - thick / 2 + 0.004, h - edge),
    )
    kit.box(
        BLACK,
        (-0.36 * w, y, low + 0.08 * (h - low)),
        (0.36 * w, y + thick / 2 + 0.02, low + 0.6 * (h - low)),
        bevel=0.012,
    )


def tv(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A flat television on two feet or a central stand."""
    w, d, h = size
    low = float(rng.uniform(0.05, 0.09))
    _screen(kit, rng, w, low, h, 0.0, 0.035)
    if rng.random() < 0.5:
        for sx in (-1, 1):
            x = sx * 0.36 * w
            kit.prism(
                BLACK, [(-d / 2, 0), (d / 2, 0), (0.02, low + 0.02), (-0.02, low + 0.02)], 0, x - 0.012, x + 0.012
            )
    else:
        kit.box(BLACK, (-0.04, -0.012, 0.01), (0.04, 0.02, low + 0.05))
        kit.prism(BLACK, [(0.26 * w * np.cos(a), 0.5 * d * np.sin(a)) for a in np.arange(20) * np.pi / 10], 2, 0, 0.014)


def wall_tv(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A flat television for a wall."""
    w, d, h = size
    _screen(kit, rng, w, 0.0, h, -d / 2 + 0.0185, 0.035)
    kit.box(BLACK, (-0.15, 0, 0.3 * h), (0.15, d / 2, 0.7 * h))


def pot(kit: Kit, rng: np.random.Generator, r: float, h: float) -> None:
    """A plant pot with earth in it."""
    tones = ((0.64, 0.33, 0.21), (0.9, 0.9, 0.88), (0.2, 0.2, 0.22), (0.55, 0.55, 0.52), (0.32, 0.42, 0.45))
    paint = paints.plain(tones[rng.integers(len(tones))], 0.2)
    kind = int(rng.integers(3))
    base = float(rng.uniform(0.65, 0.85)) * r
    if kind == 0:
        profile = [
            (0, 0),
            (base, 0),
            (r * 0.96, h * 0.82),
            (r * 1.0, h * 0.82),
            (r, h),
            (r * 0.88, h),
            (r * 0.86, h * 0.9),
            (0, h * 0.9),
        ]
        kit.lathe(paint, profile, sides=18)
    elif kind == 1:
        kit.lathe(
            paint,
            [
                (0, 0),
                (0.7 * r, 0),
                (0.95 * r, 0.25 * h),
                (r, 0.55 * h),
                (0.82 * r, h),
                (0.74 * r, h),
                (0.7 * r, 0.9 * h),
                (0, 0.9 * h),
            ],
            sides=18,
        )
    else:
        s = 0.94 * r
        kit.box(paint, (-s, -s, 0), (s, s, h), bevel=0.01)
    soil = paints.plain((0.16, 0.11, 0.08), 0.0)
    top = (1.003 if kind == 2 else 0.93) * h
    kit.lathe(soil, [(0.86 * r if kind != 1 else 0.72 * r, top - 0.004), (0, top + 0.004)], sides=14)


def plant(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A plant in a pot: broad leaves on stems, a palm or yucca, upright blades, or a little tree."""
    w, _, h = size
    pot_h = float(rng.uniform(0.16, 0.3)) * h if h > 0.8 else float(rng.uniform(0.28, 0.42)) * h
    pot_r = min(0.36 * w, 0.75 * pot_h)
    pot(kit, rng, pot_r, pot_h)
    greens = [paints.leaf(rng) for _ in range(1)]
    greens += [paints.darker(greens[0], float(f)) for f in (0.78, 1.22)]
    stem = paints.plain((0.3, 0.36, 0.18), 0.0)
    bark = paints.plain((0.36, 0.26, 0.18), 0.0)
    kind = int(rng.integers(5))
    base = 0.93 * pot_h
    reach = 0.5 * w

    def green():
        return greens[rng.integers(3)]

    if kind == 0:  # broad leaves on stems of their own
        for i in range(int(rng.integers(12, 20))):
            azimuth = i * 2.4 + rng.normal(0, 0.25)
            top = base + (h - base) * rng.uniform(0.35, 0.97)
            out = reach * rng.uniform(0.2, 0.6)
            tip = (out * float(np.cos(azimuth)), out * float(np.sin(azimuth)), top)
            bend = (0.3 * tip[0], 0.3 * tip[1], 0.5 * top + 0.55 * base)
            kit.tube(stem, [(0.0, 0.0, base - 0.01), bend, tip], 0.006, sides=4)
            kit.leaf(green(), tip, azimuth, 0.55 * reach + 0.08, 0.4 * reach + 0.04, 0.35, 1.1, 4)
    elif kind == 1:  # palm: long fronds from one or two trunks
        for trunk in range(int(rng.integers(1, 3))):
            x, y = (0.0, 0.0) if trunk == 0 else rng.uniform(-0.3, 0.3, 2) * pot_r
            crown = base + (h - base) * (rng.uniform(0.3, 0.55) if trunk == 0 else rng.uniform(0.1, 0.3))
            kit.tube(
                bark,
                [(x, y, base - 0.01), (x * 1.3, y * 1.3, 0.5 * (base + crown)), (x, y, crown + 0.02)],
                [0.03, 0.024, 0.02],
                sides=7,
            )
            for i in range(int(rng.integers(20, 30))):
                rise = rng.uniform(0.1, 1.45)
                kit.leaf(
                    green(),
                    (x, y, crown),
                    i * 2.4 + rng.normal(0, 0.2),
                    rng.uniform(0.75, 1.0) * max(h - crown, 0.8 * reach),
                    0.045 + 0.03 * reach,
                    rise,
                    rng.uniform(0.3, 1.5),
                    4,
                )
    elif kind == 2:  # upright blades
        for i in range(int(rng.integers(12, 22))):
            r = 0.6 * pot_r * np.sqrt(rng.random())
            a = i * 2.4
            kit.leaf(
                green(),
                (r * np.cos(a), r * np.sin(a), base - 0.01),
                a,
                (h - base) * rng.uniform(0.6, 1.0),
                0.05 + 0.08 * reach,
                rng.uniform(1.2, 1.5),
                rng.uniform(-0.1, 0.25),
                4,
            )
    else:  # a bush or little tree of small leaves
        bare = 0.05 if kind == 3 else rng.uniform(0.25, 0.45)
        crown_low = base + bare * (h - base)
        kit.tube(
            bark, [(0, 0, base - 0.01), (0.02, 0.01, 0.5 * (base + h)), (0, 0, 0.8 * h)], [0.022, 0.016, 0.006], sides=6
        )
        for i in range(int(rng.integers(80, 110))):
            z = rng.uniform(crown_low, 0.95 * h)
            t = (z - crown_low) / max(h - crown_low, 1e-3)
            out = reach * (0.25 + 0.65 * np.sin(np.pi * (0.15 + 0.75 * t))) * rng.uniform(0.15, 0.95)
            a = i * 2.4 + rng.normal(0, 0.4)
            kit.leaf(
                green(),
                (out * np.cos(a), out * np.sin(a), z),
                a + rng.normal(0, 0.7),
                0.06 + 0.16 * reach,
                0.04 + 0.1 * reach,
                rng.uniform(-0.2, 0.7),
                0.9,
                2,
            )
        for i in range(8):
            a, z = i * 2.4, crown_low + (0.85 * h - crown_low) * i / 8
            kit.tube(
                bark,
                [(0, 0, z), (0.5 * reach * np.cos(a), 0.5 * reach * np.sin(a), z + 0.12 * (h - base))],
                [0.008, 0.003],
                sides=4,
            )


def floor_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A standard lamp with a shade."""
    w, _, h = size
    _lamp(kit, rng, w, h, 0.3 * w + 0.04, 0.28)


def table_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A table lamp with a shade."""
    w, _, h = size
    _lamp(kit, rng, w, h, 0.32 * w, 0.45 * h)


def _lamp(kit: Kit, rng, w: float, h: float, foot: float, shade_h: float) -> None:
    stand = paints.metal(rng) if rng.random() < 0.6 else paints.wood(rng)
    shade = paints.plain(
        tuple(
            float(c)
            for c in np.clip(np.array([0.95, 0.9, 0.8]) * rng.uniform(0.75, 1.05) + rng.normal(0, 0.04, 3), 0, 1)
        ),
        0.0,
    )
    low = h - shade_h
    if h < 0.8 and rng.random() < 0.5:
        b = 0.3 * w
        kit.lathe(
            stand,
            [
                (0, 0),
                (0.7 * b, 0),
                (b, 0.3 * low),
                (0.8 * b, 0.65 * low),
                (0.2 * b, 0.95 * low),
                (0.1 * b, low + 0.02),
                (0, low + 0.02),
            ],
            sides=16,
        )
    else:
        kit.lathe(
            stand, [(0, 0), (foot, 0), (foot, 0.012), (0.012, 0.03), (0.011, low + 0.02), (0, low + 0.02)], sides=16
        )
    top = float(rng.uniform(0.55, 1.0)) * w / 2
    kit.lathe(
        shade,
        [(w / 2, low), (top, h), (0.9 * top, h), (0.2 * top, h - 0.01), (0.96 * w / 2, low + 0.004), (w / 2, low)],
        sides=22,
    )


def desk_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lamp with a jointed arm."""
    w, d, h = size
    paint = paints.board(rng) if rng.random() < 0.5 else paints.metal(rng)
    r = 0.32 * min(w, d)
    y = d / 2 - r
    kit.lathe(paint, [(0, 0), (r, 0), (r, 0.015), (0.02, 0.03), (0, 0.03)], (0, y), 16)
    kit.tube(paint, [(0, y, 0.02), (0, d / 2 - 0.01, 0.55 * h)], 0.008, sides=6)
    kit.tube(paint, [(0, d / 2 - 0.01, 0.55 * h), (0, -0.1 * d, h - 0.03)], 0.008, sides=6)
    with kit.placed((0, -0.1 * d, h - 0.05), turn_x(-0.7)):
        kit.lathe(paint, [(0.42 * w, -0.11), (0.3 * w, -0.03), (0.1 * w, 0.02), (0, 0.03)], sides=14)
        kit.lathe(paint, [(0, 0.0), (0.28 * w, -0.035), (0.4 * w, -0.11), (0.42 * w, -0.11)], sides=14)


def hanging_lamp(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A lamp on a cord from the ceiling."""
    w, _, h = size
    shade = paints.board(rng) if rng.random() < 0.6 else paints.metal(rng)
    bulb = paints.plain((1.0, 0.96, 0.86), 0.0)
    high = min(0.3, 0.45 * h)
    kit.tube(BLACK, [(0, 0, high), (0, 0, h - 0.01)], 0.005, sides=5)
    kit.lathe(shade, [(0, h - 0.03), (0.05, h - 0.03), (0.05, h), (0, h)], sides=12)
    if rng.random() < 0.3:
        kit.lathe(
            bulb, [(w / 2 * np.sin(t), high / 2 - high / 2 * np.cos(t)) for t in np.linspace(0, np.pi, 10)], sides=18
        )
        return
    kit.lathe(shade, [(w / 2, 0), (0.42 * w, 0.4 * high), (0.18 * w, 0.8 * high), (0.03, high), (0, high)], sides=20)
    kit.lathe(
        paints.plain((0.95, 0.93, 0.88), 0.0),
        [(0, 0.9 * high), (0.17 * w, 0.78 * high), (0.41 * w, 0.38 * high), (w / 2, 0)],
        sides=20,
    )
    kit.lathe(bulb, [(0.045 * np.sin(t), 0.45 * high - 0.045 * np.cos(t)) for t in np.linspace(0, np.pi, 7)], sides=10)


def rug(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A rug."""
    from sbm_gym.worlds import surfaces

    w, d, h = size
    picture = surfaces.rug(rng)
    paint = paints.Paint(texture=picture, tile_m=None)
    tone = picture[0, 0] / 255.0
    kit.card(paint, [(-w / 2, -d / 2, h), (w / 2, -d / 2, h), (w / 2, d / 2, h), (-w / 2, d / 2, h)])
    kit.box(
        paints.plain((float(tone[0]), float(tone[1]), float(tone[2])), 0.0),
        (-w / 2, -d / 2, 0),
        (w / 2, d / 2, 0.8 * h),
    )


def radiator(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A radiator: a ribbed panel or a row of columns."""
    w, d, h = size
    white = paints.plain((0.92, 0.92, 0.9), 0.25)
    if rng.random() < 0.5:
        kit.box(white, (-w / 2, -d / 2, 0.08), (w / 2, d / 2 - 0.02, h), bevel=0.006)
        for x in np.arange(-w / 2 + 0.04, w / 2 - 0.02, 0.05):
            kit.box(white, (x - 0.012, -d / 2 - 0.006, 0.13), (x + 0.012, -d / 2 + 0.004, h - 0.04), bevel=0.004)
    else:
        for x in np.linspace(-w / 2 + 0.03, w / 2 - 0.03, max(4, round(w / 0.065))):
            kit.box(white, (x - 0.024, -d / 2, 0.09), (x + 0.024, d / 2 - 0.02, h), bevel=0.02)
    for sx in (-1, 1):
        kit.box(white, (sx * 0.4 * w - 0.015, -0.2 * d, 0), (sx * 0.4 * w + 0.015, d / 2, 0.14))


def waste_bin(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bin, open or with a domed lid."""
    w, _, h = size
    paint = paints.metal(rng) if rng.random() < 0.5 else paints.board(rng)
    r = w / 2
    if rng.random() < 0.5:
        kit.lathe(paint, [(0, 0), (0.75 * r, 0), (r, h), (0.96 * r, h), (0.72 * r, 0.02), (0, 0.02)], sides=20)
    else:
        kit.lathe(
            paint,
            [(0, 0), (r, 0), (r, 0.78 * h), (0.97 * r, 0.8 * h), (0.85 * r, 0.92 * h), (0.45 * r, 0.985 * h), (0, h)],
            sides=20,
        )


def table_thing(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A vase, a bowl with fruit, a bottle or a cup."""
    w, _, h = size
    r = w / 2
    paint = paints.plain(tuple(rng.uniform(0.15, 0.9, 3)), 0.5, 0.6)
    kind = 0 if h > 0.2 else 1
    if kind == 0 and rng.random() < 0.5:
        kit.lathe(
            paint,
            [
                (0, 0),
                (0.6 * r, 0),
                (r, 0.35 * h),
                (0.8 * r, 0.65 * h),
                (0.4 * r, 0.85 * h),
                (0.5 * r, h),
                (0.42 * r, h),
                (0.3 * r, 0.85 * h),
                (0, 0.8 * h),
            ],
            sides=18,
        )
    elif kind == 0:
        kit.lathe(
            paint,
            [
                (0, 0),
                (r, 0),
                (r, 0.6 * h),
                (0.35 * r, 0.74 * h),
                (0.33 * r, 0.97 * h),
                (0.38 * r, 0.975 * h),
                (0.38 * r, h),
                (0, h),
            ],
            sides=16,
        )
    else:
        kit.lathe(
            paint,
            [
                (0, 0),
                (0.4 * r, 0),
                (0.75 * r, 0.35 * h),
                (r, 0.75 * h),
                (0.96 * r, 0.75 * h),
                (0.7 * r, 0.36 * h),
                (0, 0.15 * h),
            ],
            sides=18,
        )
        for i in range(4):
            fruit = paints.plain(
                ((0.75, 0.15, 0.1), (0.9, 0.55, 0.1), (0.5, 0.65, 0.15), (0.92, 0.8, 0.2))[rng.integers(4)], 0.2
            )
            a, f = i * 1.6, 0.33 * r
            kit.lathe(
                fruit,
                [(f * np.sin(t), h - f - f * np.cos(t)) for t in np.linspace(0, np.pi, 7)],
                (0.42 * r * np.cos(a), 0.42 * r * np.sin(a)),
                10,
            )


def desk_thing(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A pile of books or papers, or a cup of pens."""
    w, d, h = size
    if rng.random() < 0.6:
        z, count = 0.0, int(rng.integers(2, 5))
        for i in range(count):
            top = h * (i + 1) / count
            paint = paints.plain(tuple(rng.uniform(0.1, 0.85, 3)), 0.1)
            with kit.placed(rotation=turn_z(0.0 if i == 0 else float(rng.normal(0, 0.12)))):
                s = 1.0 if i == 0 else 0.82
                kit.box(paint, (-s * w / 2, -s * d / 2, z), (s * w / 2, s * d / 2, z + 0.003))
                kit.box(paint, (-s * w / 2, -s * d / 2, top - 0.003), (s * w / 2, s * d / 2, top))
                kit.box(
                    paints.plain((0.9, 0.88, 0.82), 0.0),
                    (-s * w / 2 + 0.004, -s * d / 2 + 0.003, z + 0.003),
                    (s * w / 2 - 0.004, s * d / 2 - 0.003, top - 0.003),
                )
                kit.box(paint, (-s * w / 2, s * d / 2 - 0.004, z), (s * w / 2, s * d / 2, top))
            z = top
        return
    r = 0.3 * min(w, d)
    kit.lathe(
        paints.board(rng),
        [(0, 0), (r, 0), (r, 0.65 * h), (0.9 * r, 0.65 * h), (0.9 * r, 0.1 * h), (0, 0.1 * h)],
        sides=14,
    )
    for i in range(5):
        a = i * 1.26
        kit.tube(
            paints.plain(tuple(rng.uniform(0.05, 0.9, 3)), 0.2),
            [
                (0.2 * r * np.cos(a), 0.2 * r * np.sin(a), 0.1 * h),
                (0.95 * w / 2 * np.cos(a), 0.95 * d / 2 * np.sin(a), h),
            ],
            0.004,
            sides=5,
        )


def washbasin(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A washbasin on a pedestal or a cabinet, with a tap."""
    w, d, h = size
    rim = h - 0.12
    if rng.random() < 0.5:
        kit.lathe(
            CERAMIC,
            [(0, 0), (0.1, 0), (0.075, 0.1), (0.07, 0.5 * rim), (0.12, rim - 0.1), (0, rim - 0.1)],
            (0, 0.12 * d),
            16,
        )
    else:
        from sbm_gym.assets.builtin_models.tables import drawers

        paint = paints.wood_or_board(rng, 0.5)
        kit.box(paint, (-0.46 * w, -0.4 * d, 0.12), (0.46 * w, d / 2, rim - 0.12))
        kit.box(paints.darker(paint, 0.5), (-0.4 * w, -0.3 * d, 0), (0.4 * w, d / 2 - 0.02, 0.12))
        drawers(
            kit, rng, paint, (-0.46 * w, 0.46 * w), (0.12, rim - 0.12), -0.4 * d, 1 if w < 0.55 else 2, 1, doors=True
        )
    kit.lathe(
        CERAMIC,
        [
            (0, rim - 0.15),
            (0.7, rim - 0.14),
            (1.0, rim - 0.02),
            (1.0, rim),
            (0.84, rim),
            (0.6, rim - 0.07),
            (0, rim - 0.1),
        ],
        (0, -0.04 * d),
        24,
        lambda p: p * [w / 2, 0.46 * d, 1],
    )
    kit.box(CERAMIC, (-0.42 * w, 0.28 * d, rim - 0.12), (0.42 * w, d / 2, rim), bevel=0.02)
    kit.tube(CHROME, [(0, 0.38 * d, rim - 0.01), (0, 0.38 * d, rim + 0.1), (0, 0.1 * d, rim + 0.09)], 0.012)
    kit.box(CHROME, (-0.01, 0.34 * d, rim + 0.1), (0.01, 0.42 * d, h))


def bathtub(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bathtub with its long side to the wall."""
    w, d, h = size
    apron = CERAMIC if rng.random() < 0.7 else paints.wood_or_board(rng, 0.4)
    rim = 0.06
    for x0, y0, x1, y1 in (
        (-w / 2, -d / 2, w / 2, -d / 2 + rim),
        (-w / 2, d / 2 - rim, w / 2, d / 2),
        (-w / 2, -d / 2 + rim, -w / 2 + rim, d / 2 - rim),
        (w / 2 - rim, -d / 2 + rim, w / 2, d / 2 - rim),
    ):
        kit.box(apron, (x0 + 0.006, y0 + 0.006, 0), (x1 - 0.006, y1 - 0.006, h - 0.03))
        kit.box(CERAMIC, (x0, y0, h - 0.035), (x1, y1, h), bevel=0.01)

    def tub(points: np.ndarray) -> np.ndarray:
        r = np.hypot(points[:, 0], points[:, 1])
        a = np.arctan2(points[:, 1], points[:, 0])
        # A superellipse: between an oval and a rectangle.
        squared = r / np.maximum((np.abs(np.cos(a)) ** 5 + np.abs(np.sin(a)) ** 5) ** 0.2, 1e-9)
        return np.stack(
            [squared * np.cos(a) * (w / 2 - rim + 0.02), squared * np.sin(a) * (d / 2 - rim + 0.02), points[:, 2]],
            axis=1,
        )

    kit.lathe(
        CERAMIC, [(1.04, h - 0.012), (0.99, h - 0.03), (0.93, 0.25), (0.82, 0.14), (0, 0.12)][::1], (0, 0), 32, tub
    )
    with kit.placed((w / 2 - 0.03, 0, h), turn_z(np.pi / 2)):
        kit.tube(CHROME, [(0, 0, -0.01), (0, 0, 0.12), (0, 0.1, 0.11)], 0.014)
