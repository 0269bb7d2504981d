"""Throw pillows."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, turn_x


def cushion(kit: Kit, rng: np.random.Generator, size: Size, lean_rad: float = 0.0) -> None:
    """A throw pillow with piped edges, lying flat, or leaning back by an angle from lying."""
    del size
    w = float(rng.uniform(0.36, 0.52))
    d = w if rng.random() < 0.65 else float(rng.uniform(0.28, 0.38))
    thick = float(rng.uniform(0.11, 0.17))
    cover = paints.fabric(rng, 0.6)
    piping = None
    if rng.random() < 0.7:
        piping = paints.darker(cover, 0.75) if rng.random() < 0.5 else paints.plain(rng.uniform(0.15, 0.9, 3), 0.0)
        if piping.texture is not None:
            mean = piping.texture.reshape(-1, 3).mean(axis=0) / 255.0
            piping = paints.plain((float(mean[0]), float(mean[1]), float(mean[2])), 0.0)
    sag, sharp = float(rng.uniform(0.02, 0.08)), float(rng.uniform(0.34, 0.5))
    with kit.placed((0, 0, 0), turn_x(lean_rad)):
        kit.pillow(cover, (w, d, thick), cells=14, piping=piping, sag=sag, sharp=sharp)


def leaning_cushion(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A throw pillow that leans against something behind it."""
    cushion(kit, rng, size, float(rng.uniform(1.0, 1.2)))
