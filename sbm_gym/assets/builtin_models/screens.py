"""Televisions."""

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.shapes import Kit, Size

SCREEN = paints.plain((0.03, 0.032, 0.037), 0.9, 0.9)


def _screen(kit: Kit, rng, w: float, low: float, h: float, y: float, thick: float) -> None:
    frame = paints.BLACK if rng.random() < 0.8 else paints.CHROME
    edge = float(rng.uniform(0.008, 0.02))
    kit.box(frame, (-w / 2, y - thick / 2, low), (w / 2, y + thick / 2, h), bevel=0.004)
    kit.box(
        SCREEN,
        (-w / 2 + edge, y - thick / 2 - 0.001, low + 1.6 * edge),
        (w / 2 - edge, y - thick / 2 + 0.004, h - edge),
    )
    kit.box(
        paints.BLACK,
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
                paints.BLACK,
                [(-d / 2, 0), (d / 2, 0), (0.02, low + 0.02), (-0.02, low + 0.02)],
                0,
                x - 0.012,
                x + 0.012,
            )
    else:
        kit.box(paints.BLACK, (-0.04, -0.012, 0.01), (0.04, 0.02, low + 0.05))
        kit.prism(
            paints.BLACK, [(0.26 * w * np.cos(a), 0.5 * d * np.sin(a)) for a in np.arange(20) * np.pi / 10], 2, 0, 0.014
        )


def wall_tv(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A flat television for a wall."""
    w, d, h = size
    _screen(kit, rng, w, 0.0, h, -d / 2 + 0.0185, 0.035)
    kit.box(paints.BLACK, (-0.15, 0, 0.3 * h), (0.15, d / 2, 0.7 * h))
