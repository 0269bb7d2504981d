"""Cookers, hoods, washing machines, and what stands on worktops."""

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.shapes import Kit, Size

_DOOR_GLASS = paints.plain((0.05, 0.05, 0.055), 0.8, 0.8)


def _body(rng: np.random.Generator) -> paints.Paint:
    """White, steel or black enamel."""
    return (paints.plain((0.92, 0.92, 0.91), 0.4, 0.6), paints.STEEL, paints.BLACK)[rng.choice(3, p=[0.45, 0.4, 0.15])]


def cooker(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A cooker: an oven with a window, a row of knobs, and a hob of glass or with gas burners."""
    w, d, h = size
    body = _body(rng)
    face = -d / 2 + 0.05
    kit.box(paints.BLACK, (-w / 2 + 0.02, face + 0.05, 0), (w / 2 - 0.02, d / 2 - 0.02, 0.08))
    kit.box(body, (-w / 2, face, 0.08), (w / 2, d / 2, h - 0.03))
    knobs, door = h - 0.13, h - 0.15
    kit.box(body, (-w / 2 + 0.003, face - 0.022, 0.26), (w / 2 - 0.003, face, door), bevel=0.004)
    kit.box(_DOOR_GLASS, (-0.36 * w, face - 0.024, 0.33), (0.36 * w, face - 0.015, door - 0.11))
    kit.tube(paints.CHROME, [(-0.4 * w, face - 0.045, door - 0.05), (0.4 * w, face - 0.045, door - 0.05)], 0.01, 8)
    for x in (-0.36 * w, 0.36 * w):
        kit.box(paints.CHROME, (x - 0.008, face - 0.04, door - 0.058), (x + 0.008, face - 0.02, door - 0.042))
    kit.box(body, (-w / 2 + 0.003, face - 0.02, 0.09), (w / 2 - 0.003, face, 0.25), bevel=0.004)
    kit.box(paints.BLACK, (-0.08, face - 0.026, knobs + 0.02), (0.08, face + 0.01, knobs + 0.07))
    grip = paints.BLACK if body is not paints.BLACK else paints.STEEL
    for x in (-0.4, -0.27, 0.27, 0.4):
        kit.prism(
            grip, [(knobs + 0.045 + 0.02 * np.cos(a), x * w + 0.02 * np.sin(a)) for a in _turns(10)], 1, -d / 2, face
        )
    hob = paints.plain((0.04, 0.04, 0.045), 0.7, 0.8)
    burners = [(sx * 0.23 * w, 0.02 + sy * 0.2 * d, 0.085 if sx * sy > 0 else 0.07) for sx in (-1, 1) for sy in (-1, 1)]
    if rng.random() < 0.5:
        kit.box(hob, (-w / 2, face - 0.02, h - 0.03), (w / 2, d / 2, h), bevel=0.003)
        for x, y, r in burners:
            ring = paints.plain((0.17, 0.16, 0.16), 0.2)
            kit.lathe(ring, [(r, h + 0.0006), (0, h + 0.0012)], (x, y), 18)
            kit.lathe(hob, [(0.86 * r, h + 0.0015), (0, h + 0.002)], (x, y), 18)
        return
    top = h - 0.022
    kit.box(body, (-w / 2, face - 0.02, h - 0.04), (w / 2, d / 2, top), bevel=0.003)
    iron = paints.plain((0.07, 0.07, 0.07), 0.1)
    for x, y, r in burners:
        kit.lathe(iron, [(0, top), (0.5 * r, top), (0.5 * r, top + 0.01), (0, top + 0.012)], (x, y), 12)
        for a in (0.0, 0.5 * np.pi):
            along, across = 1.15 * r * np.array([np.cos(a), np.sin(a)]), 0.005 * np.array([np.sin(a), np.cos(a)])
            low, high = -np.abs(along) - across, np.abs(along) + across
            kit.box(iron, (x + low[0], y + low[1], h - 0.008), (x + high[0], y + high[1], h))
            for s in (-1, 1):
                fx, fy = x + s * along[0], y + s * along[1]
                kit.box(iron, (fx - 0.005, fy - 0.005, top - 0.002), (fx + 0.005, fy + 0.005, h - 0.004))


def _turns(count: int) -> np.ndarray:
    return np.arange(count) * 2 * np.pi / count


def cooker_hood(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A hood over a cooker: a canopy with a flue above it."""
    w, d, h = size
    metal = paints.STEEL if rng.random() < 0.6 else _body(rng)
    lip = 0.05
    kit.box(metal, (-w / 2, -d / 2, 0), (w / 2, d / 2, lip), bevel=0.003)
    flue, middle = 0.13, d / 2 - 0.14
    slope = float(rng.uniform(0.1, 0.24))
    rings = [(-w / 2, w / 2, -d / 2, d / 2, lip), (-flue, flue, middle - 0.12, d / 2, lip + slope)]
    corners = [[(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)] for x0, x1, y0, y1, z in rings]
    for i in range(4):
        j = (i + 1) % 4
        kit.card(metal, [corners[0][i], corners[0][j], corners[1][j], corners[1][i]])
    kit.box(metal, (-flue, middle - 0.12, lip + slope - 0.002), (flue, d / 2, h))
    kit.box(paints.BLACK, (-0.42 * w, -0.38 * d, -0.004), (0.42 * w, 0.3 * d, 0.01))
    for x in (-0.06, -0.02, 0.02, 0.06):
        kit.box(paints.BLACK, (x - 0.008, -d / 2 - 0.003, 0.018), (x + 0.008, -d / 2 + 0.01, 0.032))


def washing_machine(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A washing machine with a porthole."""
    w, d, h = size
    body = paints.plain((0.92, 0.92, 0.92), 0.4, 0.6)
    face = -d / 2 + 0.03
    kit.box(body, (-w / 2, face, 0.02), (w / 2, d / 2, h - 0.03), bevel=0.01)
    kit.box(body, (-w / 2, face - 0.01, h - 0.034), (w / 2, d / 2, h), bevel=0.008)
    kit.box(paints.BLACK, (-w / 2 + 0.04, face + 0.04, 0), (w / 2 - 0.04, d / 2 - 0.04, 0.03))
    kit.box(
        paints.darker(body, 0.9), (-w / 2 + 0.01, face - 0.008, h - 0.15), (w / 2 - 0.01, face + 0.01, h - 0.04), 0.004
    )
    kit.box(body, (-w / 2 + 0.02, face - 0.014, h - 0.14), (-w / 2 + 0.2, face, h - 0.05), bevel=0.004)
    kit.box(_DOOR_GLASS, (0.06, face - 0.01, h - 0.115), (0.2, face, h - 0.07))
    middle = 0.47 * h
    for paint, r, out in (
        (paints.CHROME if rng.random() < 0.6 else paints.BLACK, 0.20, 0.022),
        (_DOOR_GLASS, 0.155, 0.03),
        (paints.plain((0.2, 0.22, 0.25), 0.9, 0.9), 0.11, 0.034),
    ):
        ring = [(middle + r * np.cos(a), r * np.sin(a)) for a in _turns(24)]
        kit.prism(paint, ring, 1, face - out, face + 0.005)
    knob = [(h - 0.095 + 0.03 * np.cos(a), 0.02 + 0.03 * np.sin(a)) for a in _turns(14)]
    kit.prism(paints.CHROME, knob, 1, -d / 2, face)


def worktop_thing(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A microwave oven, a toaster, a kettle, a knife block or jars, as the size allows."""
    w, d, h = size
    if w > 0.4:
        body = _body(rng)
        kit.box(body, (-w / 2, -d / 2 + 0.02, 0.012), (w / 2, d / 2, h), bevel=0.006)
        kit.box(_DOOR_GLASS, (-w / 2 + 0.015, -d / 2 + 0.012, 0.03), (0.24 * w, -d / 2 + 0.03, h - 0.02))
        kit.box(paints.darker(body, 0.8), (0.26 * w, -d / 2 + 0.014, 0.03), (w / 2 - 0.012, -d / 2 + 0.03, h - 0.02))
        kit.box(paints.CHROME, (0.2 * w, -d / 2, 0.05), (0.225 * w, -d / 2 + 0.016, h - 0.04))
        for sx in (-1, 1):
            kit.box(paints.BLACK, (sx * 0.4 * w - 0.02, -0.3 * d, 0), (sx * 0.4 * w + 0.02, 0.3 * d, 0.014))
        return
    kind = int(rng.integers(4))
    paint = paints.STEEL if rng.random() < 0.4 else paints.plain(tuple(rng.uniform(0.1, 0.9, 3)), 0.5, 0.6)
    if kind == 0:  # toaster
        kit.box(paint, (-w / 2, -0.32 * d, 0.01), (w / 2, 0.32 * d, h), bevel=0.03)
        for y in (-0.12 * d, 0.12 * d):
            kit.box(paints.BLACK, (-0.36 * w, y - 0.014, h - 0.01), (0.36 * w, y + 0.014, h + 0.001))
        kit.box(paints.BLACK, (w / 2, -0.02, 0.5 * h), (w / 2 + 0.02, 0.02, 0.58 * h))
        kit.box(paints.BLACK, (-0.4 * w, -0.26 * d, 0), (0.4 * w, 0.26 * d, 0.014))
    elif kind == 1:  # kettle
        r = 0.4 * w
        profile = [(0, 0), (r, 0), (0.98 * r, 0.3 * h), (0.7 * r, 0.82 * h), (0.3 * r, 0.92 * h), (0, 0.93 * h)]
        kit.lathe(paint, profile, sides=18)
        kit.lathe(paints.BLACK, [(0, 0.9 * h), (0.1 * r, 0.92 * h), (0.14 * r, h), (0, h)], sides=10)
        kit.tube(paint, [(0.8 * r, 0, 0.5 * h), (1.3 * r, 0, 0.82 * h)], [0.03, 0.014], 8)
        grip = [(-0.6 * r, 0, 0.84 * h), (-1.2 * r, 0, 0.75 * h), (-1.15 * r, 0, 0.35 * h), (-0.9 * r, 0, 0.2 * h)]
        kit.tube(paints.BLACK, grip, 0.014, 7)
    elif kind == 2:  # knife block
        wood = paints.wood(rng)
        side = [(-0.4 * d, 0), (0.45 * d, 0), (0.45 * d, 0.35 * h), (0.0, 0.78 * h), (-0.4 * d, 0.5 * h)]
        kit.prism(wood, side, 0, -0.5 * w, 0.5 * w)
        for i in range(4):
            x = (-0.33 + 0.22 * i) * w
            kit.tube(paints.BLACK, [(x, -0.2 * d, 0.6 * h), (x, -0.42 * d, h - 0.012)], 0.01, 6)
    else:  # jars
        r = 0.15 * w
        lid = paints.wood(rng)
        for i in range(3):
            x, high = (i - 1) * 0.32 * w, h * (1.0, 0.84, 0.7)[i]
            kit.lathe(paint, [(0, 0), (r, 0), (r, high - 0.025), (0, high - 0.025)], (x, 0), 14)
            kit.lathe(lid, [(0.9 * r, high - 0.025), (0.95 * r, high), (0, high)], (x, 0), 14)
