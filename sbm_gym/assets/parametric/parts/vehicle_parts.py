"""What builtin vehicles share: paint, glass, wheels, lofted bodies."""

import colorsys

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, circle, fan_triangles, grid_triangles

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


def loft(kit: Kit, paint: paints.Paint, places, halves, lows, tops, bevel: float) -> None:
    """A closed body along Y with softened edges; places are y of its cross sections, halves are half their widths."""
    rings = []
    for y, half, low, high in zip(places, halves, lows, tops, strict=True):
        b = min(bevel, 0.45 * half, 0.45 * (high - low))
        ring = [
            (-half, low + b), (-half, high - b), (-half + b, high), (half - b, high),
            (half, high - b), (half, low + b), (half - b, low), (-half + b, low), (-half, low + b),
        ]  # fmt: skip
        rings.append([(x, y, z) for x, z in ring])
    points = np.array(rings, float).swapaxes(0, 1)
    last, first = fan_triangles(points[:8, -1]), fan_triangles(points[:8, 0])[:, [0, 2, 1]]
    kit.add(paint, np.concatenate([grid_triangles(points), last, first]), crease_rad=np.deg2rad(35))


def wheel(kit: Kit, x: float, y: float, r: float, wide: float) -> None:
    """A wheel whose outer face is at x, away from the middle."""
    side = np.sign(x)
    for paint, radius, a, b in (
        (TYRE, r, x, x - side * wide),
        (RIM, 0.62 * r, x + side * 0.006, x - side * 0.02),
        (DARK, 0.16 * r, x + side * 0.012, x),
    ):
        kit.prism(paint, circle((y, r), radius, 18), 0, a, b)


def arch(kit: Kit, x: float, y: float, r: float) -> None:
    """The dark opening of a wheel house."""
    side = np.sign(x)
    outline = [(y + 1.16 * r * np.cos(t), r + 1.16 * r * np.sin(t)) for t in np.linspace(-0.2, np.pi + 0.2, 14)]
    kit.prism(DARK, outline, 0, x - side * 0.12, x + side * 0.003)


def spoked_wheel(kit: Kit, y: float, r: float) -> None:
    """A wheel of a bicycle whose middle is at y."""
    tyre = 0.018

    def rim(angle: float) -> tuple[float, float, float]:
        return 0, y + (r - tyre) * np.cos(angle), r + (r - tyre) * np.sin(angle)

    kit.tube(TYRE, [rim(a) for a in np.linspace(0, 2 * np.pi, 25)], tyre, sides=6)
    for a in np.arange(12) * 2 * np.pi / 12:
        kit.tube(RIM, [(0, y, r), rim(a)], 0.004, sides=4)
