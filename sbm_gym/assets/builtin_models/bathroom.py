"""Toilets, basins, baths, showers, mirrors and towels."""

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.cabinets import drawers
from sbm_gym.assets.builtin_models.shapes import Kit, Size, turn_x, turn_z


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
            paints.CERAMIC,
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
    seat_tone = paints.CERAMIC if rng.random() < 0.85 else paints.wood(rng)
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
        paints.CERAMIC,
        (-0.45 * bowl_w, middle + 0.2 * bowl_d, 0.0 if skirted else rim - 0.2),
        (0.45 * bowl_w, d / 2 - 0.02, rim - 0.01),
        bevel=0.03,
    )
    tank_w = min(w, float(rng.uniform(0.34, 0.44)))
    kit.box(paints.CERAMIC, (-tank_w / 2, d / 2 - tank_d, rim - 0.02), (tank_w / 2, d / 2, h - 0.03), bevel=0.025)
    kit.box(
        paints.CERAMIC,
        (-tank_w / 2 - 0.005, d / 2 - tank_d - 0.006, h - 0.04),
        (tank_w / 2 + 0.005, d / 2, h - 0.006),
        bevel=0.012,
    )
    kit.lathe(paints.CHROME, [(0, h - 0.006), (0.022, h - 0.006), (0.02, h), (0, h)], (0, d / 2 - tank_d / 2), 12)


def washbasin(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A washbasin on a pedestal or a cabinet, with a tap."""
    w, d, h = size
    rim = h - 0.12
    if rng.random() < 0.5:
        kit.lathe(
            paints.CERAMIC,
            [(0, 0), (0.1, 0), (0.075, 0.1), (0.07, 0.5 * rim), (0.12, rim - 0.1), (0, rim - 0.1)],
            (0, 0.12 * d),
            16,
        )
    else:
        paint = paints.wood_or_board(rng, 0.5)
        kit.box(paint, (-0.46 * w, -0.4 * d, 0.12), (0.46 * w, d / 2, rim - 0.12))
        kit.box(paints.darker(paint, 0.5), (-0.4 * w, -0.3 * d, 0), (0.4 * w, d / 2 - 0.02, 0.12))
        drawers(
            kit, rng, paint, (-0.46 * w, 0.46 * w), (0.12, rim - 0.12), -0.4 * d, 1 if w < 0.55 else 2, 1, doors=True
        )
    kit.lathe(
        paints.CERAMIC,
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
    kit.box(paints.CERAMIC, (-0.42 * w, 0.28 * d, rim - 0.12), (0.42 * w, d / 2, rim), bevel=0.02)
    kit.tube(paints.CHROME, [(0, 0.38 * d, rim - 0.01), (0, 0.38 * d, rim + 0.1), (0, 0.1 * d, rim + 0.09)], 0.012)
    kit.box(paints.CHROME, (-0.01, 0.34 * d, rim + 0.1), (0.01, 0.42 * d, h))


def bathtub(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bathtub with its long side to the wall."""
    w, d, h = size
    apron = paints.CERAMIC if rng.random() < 0.7 else paints.wood_or_board(rng, 0.4)
    rim = 0.06
    for x0, y0, x1, y1 in (
        (-w / 2, -d / 2, w / 2, -d / 2 + rim),
        (-w / 2, d / 2 - rim, w / 2, d / 2),
        (-w / 2, -d / 2 + rim, -w / 2 + rim, d / 2 - rim),
        (w / 2 - rim, -d / 2 + rim, w / 2, d / 2 - rim),
    ):
        kit.box(apron, (x0 + 0.006, y0 + 0.006, 0), (x1 - 0.006, y1 - 0.006, h - 0.03))
        kit.box(paints.CERAMIC, (x0, y0, h - 0.035), (x1, y1, h), bevel=0.01)

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
        paints.CERAMIC,
        [(1.04, h - 0.012), (0.99, h - 0.03), (0.93, 0.25), (0.82, 0.14), (0, 0.12)][::1],
        (0, 0),
        32,
        tub,
    )
    with kit.placed((w / 2 - 0.03, 0, h), turn_z(np.pi / 2)):
        kit.tube(paints.CHROME, [(0, 0, -0.01), (0, 0, 0.12), (0, 0.1, 0.11)], 0.014)


def shower(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A shower cubicle for a corner: a tray, panes of glass at three sides, a head on a rail at the back."""
    w, d, h = size
    tray = float(rng.uniform(0.05, 0.14))
    kit.box(paints.CERAMIC, (-w / 2, -d / 2, 0), (w / 2, d / 2, tray), bevel=0.012)
    kit.box(
        paints.darker(paints.CERAMIC, 0.92),
        (-w / 2 + 0.06, -d / 2 + 0.06, tray - 0.002),
        (w / 2 - 0.06, d / 2 - 0.06, tray + 0.001),
    )
    kit.lathe(paints.CHROME, [(0.045, tray + 0.001), (0.04, tray + 0.004), (0, tray + 0.004)], (0, 0), sides=14)
    post = paints.CHROME if rng.random() < 0.7 else paints.plain((0.93, 0.93, 0.93), 0.3)
    t = 0.024
    for x in (-w / 2, w / 2 - t):
        for y in (-d / 2, d / 2 - t):
            kit.box(post, (x, y, tray - 0.01), (x + t, y + t, h))
    for z in (tray, h - t):
        kit.box(post, (-w / 2 + t, -d / 2 + 0.004, z), (w / 2 - t, -d / 2 + t - 0.004, z + t))
        for x in (-w / 2 + 0.004, w / 2 - t + 0.004):
            kit.box(post, (x, -d / 2 + t, z), (x + t - 0.008, d / 2 - t, z + t))
    low, top = tray + t, h - t
    half = 0.5 * t
    panes = [((-w / 2 + t, -d / 2 + half), (w / 2 - t, -d / 2 + half))]
    panes += [((x, -d / 2 + t), (x, d / 2 - t)) for x in (-w / 2 + half, w / 2 - half)]
    for (x0, y0), (x1, y1) in panes:
        kit.card(paints.GLASS, [(x0, y0, low), (x1, y1, low), (x1, y1, top), (x0, y0, top)])
    split = 0.1 * w
    kit.box(post, (split - 0.01, -d / 2 + 0.002, low), (split + 0.01, -d / 2 + t - 0.002, top))
    kit.tube(post, [(split + 0.06, -d / 2 - 0.03, 0.95), (split + 0.06, -d / 2 - 0.03, 1.2)], 0.008, sides=6)
    for z in (0.97, 1.18):
        kit.tube(post, [(split + 0.06, -d / 2 - 0.03, z), (split + 0.06, -d / 2 + 0.012, z)], 0.006, sides=6)
    rail = d / 2 - 0.05
    kit.tube(paints.CHROME, [(0, rail, 1.0), (0, rail, h - 0.12)], 0.011, sides=8)
    kit.tube(paints.CHROME, [(0, rail, h - 0.13), (0, rail - 0.1, h - 0.06), (0, rail - 0.22, h - 0.1)], 0.01, sides=8)
    kit.lathe(paints.CHROME, [(0, h - 0.13), (0.09, h - 0.13), (0.085, h - 0.115), (0, h - 0.1)], (0, rail - 0.22), 18)
    kit.box(paints.CHROME, (-0.12, rail - 0.01, 1.02), (0.12, rail + 0.05, 1.07), bevel=0.015)


def mirror(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A mirror for a wall, with a frame, without one, or round; it shows the pale room that it would reflect."""
    w, d, h = size
    rows, columns = np.mgrid[0:96, 0:64] / np.array([[[96.0]], [[64.0]]])
    glance = 0.03 * np.sin(9.0 * (columns + 0.6 * rows)) * (columns > 0.3)
    tone = np.array([0.74, 0.80, 0.83]) * (0.92 + 0.12 * (1 - rows) + glance)[..., None]
    glass = paints.Paint(texture=paints.picture(tone), tile_m=None, specular=0.6, shininess=0.9)
    frame = paints.wood(rng) if rng.random() < 0.5 else paints.metal(rng)
    kind = int(rng.integers(3))
    face = -d / 2
    if kind == 0:
        turn = np.arange(32) * np.pi / 16
        for paint, scale, front in ((frame, 1.0, face), (None, 0.93, face)):
            ring = [(0.5 * h + 0.5 * scale * h * np.cos(a), 0.5 * scale * w * np.sin(a)) for a in turn]
            if paint is not None:
                kit.prism(paint, ring, 1, front + 0.006, d / 2)
            else:
                flat = paints.plain((0.74, 0.80, 0.83), 0.6, 0.9)
                kit.prism(flat, ring, 1, front, front + 0.008)
        return
    edge = float(rng.uniform(0.015, 0.05)) if kind == 1 else 0.004
    kit.box(frame if kind == 1 else paints.STEEL, (-w / 2, face + 0.004, 0), (w / 2, d / 2, h))
    if kind == 1:
        for low, high in (
            ((-w / 2, 0.0), (w / 2, edge)),
            ((-w / 2, h - edge), (w / 2, h)),
            ((-w / 2, edge), (-w / 2 + edge, h - edge)),
            ((w / 2 - edge, edge), (w / 2, h - edge)),
        ):
            kit.box(frame, (low[0], face, low[1]), (high[0], face + 0.006, high[1]))
    a, b = -w / 2 + edge, w / 2 - edge
    y = face + (0.003 if kind == 1 else 0.0)
    kit.card(glass, [(a, y, edge), (b, y, edge), (b, y, h - edge), (a, y, h - edge)])


def towel_rail(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A rail on a wall with one towel or two over it."""
    w, d, h = size
    bar = h - 0.03
    rod = paints.CHROME if rng.random() < 0.7 else paints.BLACK
    kit.tube(rod, [(-w / 2, 0, bar), (w / 2, 0, bar)], 0.009, sides=8)
    for x in (-w / 2 + 0.012, w / 2 - 0.012):
        kit.box(rod, (x - 0.012, -0.012, bar - 0.02), (x + 0.012, d / 2, bar + 0.02), bevel=0.004)
    count = int(rng.integers(1, 3))
    cloth = [paints.fabric(rng, 0.3) for _ in range(count)]
    for i in range(count):
        middle = (i - (count - 1) / 2) * 0.46 * w
        wide = (0.38 if count == 2 else 0.6) * w
        low = float(rng.uniform(0.0, 0.15)) * h if i else 0.0
        x0, x1 = middle - wide / 2, middle + wide / 2
        kit.box(cloth[i], (x0, -d / 2, low), (x1, -0.008, bar + 0.01), bevel=0.008)
        kit.box(cloth[i], (x0, 0.008, low + 0.12 * h), (x1, 0.024, bar + 0.01), bevel=0.005)
        kit.box(cloth[i], (x0, -d / 2, bar), (x1, 0.024, bar + 0.018), bevel=0.008)
