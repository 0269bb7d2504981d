"""Televisions."""

import numpy as np

from sbm_gym.assets.models import surfaces
from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, circle

ON_SHARE = 0.3
"""How many televisions show a picture; the others are dark, with the sheen of a window on them."""


def _picture(rng: np.random.Generator) -> paints.Paint:
    """What a screen shows."""
    if rng.random() < ON_SHARE:
        shown = surfaces.landscape(rng)[::2, ::2] / 255.0
        return paints.Paint(texture=paints.picture(0.9 * shown), tile_m=None, specular=0.4, shininess=0.8)
    rows, columns = np.mgrid[0:48, 0:80] / np.array([[[48.0]], [[80.0]]])
    slant = columns + float(rng.uniform(-0.6, 0.6)) * rows
    sheen = np.exp(-(((slant - float(rng.uniform(0.2, 0.8))) / float(rng.uniform(0.15, 0.4))) ** 2))
    dark = np.array([0.045, 0.05, 0.06]) * (1.0 + 1.6 * sheen + 0.5 * (1.0 - rows))[..., None]
    return paints.Paint(texture=paints.picture(dark), tile_m=None, specular=0.9, shininess=0.9)


def _screen(kit: Kit, rng: np.random.Generator, w: float, low: float, h: float, y: float, thick: float) -> None:
    frame = paints.BLACK if rng.random() < 0.8 else paints.CHROME
    edge = float(rng.uniform(0.008, 0.02))
    kit.box(frame, (-w / 2, y - thick / 2, low), (w / 2, y + thick / 2, h), bevel=0.004)
    kit.picture(_picture(rng), (-w / 2 + edge, w / 2 - edge), (low + 1.6 * edge, h - edge), y - thick / 2 - 0.002)
    z0, z1 = low + 0.08 * (h - low), low + 0.6 * (h - low)
    kit.box(paints.BLACK, (-0.36 * w, y, z0), (0.36 * w, y + thick / 2 + 0.02, z1), bevel=0.012)


def tv(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A flat television on two feet or a central stand."""
    w, d, h = size
    low = float(rng.uniform(0.05, 0.09))
    _screen(kit, rng, w, low, h, 0.0, 0.035)
    if rng.random() < 0.5:
        foot = [(-d / 2, 0), (d / 2, 0), (0.02, low + 0.02), (-0.02, low + 0.02)]
        for x in (-0.36 * w, 0.36 * w):
            kit.prism(paints.BLACK, foot, 0, x - 0.012, x + 0.012)
    else:
        kit.box(paints.BLACK, (-0.04, -0.012, 0.01), (0.04, 0.02, low + 0.05))
        kit.prism(paints.BLACK, circle((0.0, 0.0), (0.26 * w, 0.5 * d), 20), 2, 0, 0.014)


def wall_tv(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A flat television for a wall."""
    w, d, h = size
    _screen(kit, rng, w, 0.0, h, -d / 2 + 0.0185, 0.035)
    kit.box(paints.BLACK, (-0.15, 0, 0.3 * h), (0.15, d / 2, 0.7 * h))
