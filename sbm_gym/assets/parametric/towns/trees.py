"""Trees made from seeds."""

import numpy as np
from jaxtyping import Float

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size

CLEAR_M = 2.4
"""Trees of streets are pruned up to this height, so that people can walk below."""
LEAVES = 1500
GREENS = 3
"""Tones of a crown."""


def tree(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A tree: a trunk with branches and a crown of leaves, round, tall or in tiers."""
    w, _, h = size
    conifer = rng.random() < 0.2
    bare = max((0.2 if conifer else float(rng.uniform(0.24, 0.36))) * h, CLEAR_M)
    _wood(kit, w, h, bare, branches=not conifer)
    green = paints.leaf(rng)
    tones = [green, paints.darker(green, 0.75), paints.darker(green, 1.25)]
    t = (np.arange(LEAVES) + 0.5) / LEAVES
    azimuth = np.arange(LEAVES) * 2.39996 + rng.normal(0, 0.2, LEAVES)
    length = rng.uniform(0.07, 0.12, LEAVES) * w
    if conifer:
        # In tiers of boughs that hang outwards.
        tiers = max(int((h - bare) / 0.55), 4)
        level = np.floor(t**0.8 * tiers) / tiers
        out = 0.46 * w * (1.0 - level) * np.sqrt(rng.uniform(0.15, 1.0, LEAVES)) + 0.03 * w
        height = bare + (h - bare) * level - 0.35 * out + 0.2 * w * (1.0 - level) + rng.normal(0, 0.03, LEAVES)
        height = np.clip(height, bare - 0.2, h - 0.3 * length)
        rise = rng.uniform(-0.7, -0.1, LEAVES)
    else:
        lift = 2.0 * t - 1.0  # even over a ball
        shell = np.sqrt(rng.uniform(0.45, 1.0, LEAVES))
        # Leaves grow in clumps, with the sky between them.
        clumps = rng.normal(size=(26, 3))
        clumps /= np.linalg.norm(clumps, axis=1, keepdims=True)
        ring = np.sqrt(1.0 - lift**2)
        towards = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), lift], axis=1)
        bulge = 0.80 + 0.2 * np.clip((towards @ clumps.T).max(axis=1) * 4.0 - 3.0, 0.0, 1.0)
        height = bare + 0.5 * (h - bare) * (1.0 + 0.96 * lift * shell * bulge)
        out = 0.47 * w * ring * shell * bulge
        rise = rng.uniform(-0.6, 0.6, LEAVES)
    places = np.stack([out * np.cos(azimuth), out * np.sin(azimuth), height], axis=1)
    tone = rng.integers(GREENS, size=LEAVES)
    azimuth = azimuth + rng.normal(0, 0.8, LEAVES)
    for number, paint in enumerate(tones):
        chosen = tone == number
        kit.add(paint, _leaves(places[chosen], azimuth[chosen], rise[chosen], length[chosen]))


def _wood(kit: Kit, w: float, h: float, bare: float, branches: bool) -> None:
    bark = paints.plain((0.30, 0.23, 0.17), 0.0)
    thick = h**0.8
    trunk = [(0, 0, 0), (0.02 * w, 0, bare), (0, 0.01 * w, 0.85 * h)]
    kit.tube(bark, trunk, [0.05 * thick, 0.035 * thick, 0.01 * h], sides=8)
    for i in range(9 if branches else 0):
        angle, z = i * 2.4, bare + (0.7 * h - bare) * i / 9
        out = 0.36 * w * (1 - 0.5 * i / 9)
        end = (out * np.cos(angle), out * np.sin(angle), min(z + 0.16 * h, 0.94 * h))
        kit.tube(bark, [(0, 0, z), end], [0.018 * thick, 0.006 * h], sides=5)


def _leaves(
    places_m: Float[np.ndarray, "n 3"],
    azimuth_rad: Float[np.ndarray, "n"],
    rise_rad: Float[np.ndarray, "n"],
    length_m: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "t 3 3"]:
    """Two triangles for each leaf, folded a little along its middle."""
    ahead = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad), np.tan(rise_rad)], axis=1)
    ahead *= (length_m / np.linalg.norm(ahead, axis=1))[:, None]
    side = 0.36 * length_m[:, None] * np.stack([-np.sin(azimuth_rad), np.cos(azimuth_rad), 0.35 + 0 * azimuth_rad], 1)
    base, tip, middle = places_m, places_m + ahead, places_m + 0.45 * ahead
    left, right = middle + side, middle + side * [-1.0, -1.0, 1.0]
    return np.concatenate([np.stack([base, tip, left], axis=1), np.stack([base, right, tip], axis=1)])
