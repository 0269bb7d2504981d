"""Fridges."""

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.shapes import Kit, Size


def fridge_size(size: Size) -> Size:
    """Only tall fridges are wide."""
    width, depth, height = size
    return (0.9 if height > 1.75 and width > 0.66 else width), depth, height


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
    grip = paints.CHROME if rng.random() < 0.7 else paints.BLACK
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
        kit.box(paints.BLACK, (-0.34 * w, front - 0.008, 0.52 * h), (-0.14 * w, front + 0.004, 0.68 * h), bevel=0.004)
    if rng.random() < 0.4:
        for _ in range(int(rng.integers(2, 6))):  # notes and magnets
            x, z = rng.uniform(-0.3, 0.2) * w, rng.uniform(0.6, 0.85) * h
            s = rng.uniform(0.03, 0.09)
            kit.box(
                paints.plain(tuple(rng.uniform(0.3, 1.0, 3)), 0.0), (x, front - 0.004, z), (x + s, front + 0.004, z + s)
            )
