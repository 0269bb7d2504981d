"""Plants in pots."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size


def pot(kit: Kit, rng: np.random.Generator, r: float, h: float) -> None:
    """A plant pot with earth in it."""
    tones = ((0.64, 0.33, 0.21), (0.9, 0.9, 0.88), (0.2, 0.2, 0.22), (0.55, 0.55, 0.52), (0.32, 0.42, 0.45))
    paint = paints.plain(tones[rng.integers(len(tones))], 0.2)
    kind = int(rng.integers(3))
    base = float(rng.uniform(0.65, 0.85)) * r
    if kind == 0:
        radii = [0, base, r * 0.96, r, r, r * 0.88, r * 0.86, 0]
        kit.lathe(paint, radii, [0, 0, 0.82, 0.82, 1, 1, 0.9, 0.9], sides=18, scale=(1.0, h))
    elif kind == 1:
        radii, heights = [0, 0.7, 0.95, 1, 0.82, 0.74, 0.7, 0], [0, 0, 0.25, 0.55, 1, 1, 0.9, 0.9]
        kit.lathe(paint, radii, heights, sides=18, scale=(r, h))
    else:
        s = 0.94 * r
        kit.box(paint, (-s, -s, 0), (s, s, h), bevel=0.01)
    soil = paints.plain((0.16, 0.11, 0.08), 0.0)
    top = (1.003 if kind == 2 else 0.93) * h
    kit.lathe(soil, [0.86 * r if kind != 1 else 0.72 * r, 0], [top - 0.004, top + 0.004], sides=14)


def plant(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A plant in a pot: broad leaves on stems, a palm or yucca, upright blades, or a little tree."""
    w, _, h = size
    pot_h = float(rng.uniform(0.16, 0.3)) * h if h > 0.8 else float(rng.uniform(0.28, 0.42)) * h
    pot_r = min(0.36 * w, 0.75 * pot_h)
    pot(kit, rng, pot_r, pot_h)
    leafy = paints.leaf(rng)
    greens = [leafy, paints.darker(leafy, 0.78), paints.darker(leafy, 1.22)]
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
            path = [(x, y, base - 0.01), (x * 1.3, y * 1.3, 0.5 * (base + crown)), (x, y, crown + 0.02)]
            kit.tube(bark, path, [0.03, 0.024, 0.02], sides=7)
            for i in range(int(rng.integers(20, 30))):
                rise, paint, a = rng.uniform(0.1, 1.45), green(), i * 2.4 + rng.normal(0, 0.2)
                length = rng.uniform(0.75, 1.0) * max(h - crown, 0.8 * reach)
                kit.leaf(paint, (x, y, crown), a, length, 0.045 + 0.03 * reach, rise, rng.uniform(0.3, 1.5), 4)
    elif kind == 2:  # upright blades
        for i in range(int(rng.integers(12, 22))):
            r = 0.6 * pot_r * np.sqrt(rng.random())
            paint, a, length = green(), i * 2.4, (h - base) * rng.uniform(0.6, 1.0)
            root, rise = (r * np.cos(a), r * np.sin(a), base - 0.01), rng.uniform(1.2, 1.5)
            kit.leaf(paint, root, a, length, 0.05 + 0.08 * reach, rise, rng.uniform(-0.1, 0.25), 4)
    else:  # a bush or little tree of small leaves
        bare = 0.05 if kind == 3 else rng.uniform(0.25, 0.45)
        crown_low = base + bare * (h - base)
        trunk = [(0, 0, base - 0.01), (0.02, 0.01, 0.5 * (base + h)), (0, 0, 0.8 * h)]
        kit.tube(bark, trunk, [0.022, 0.016, 0.006], sides=6)
        for i in range(int(rng.integers(80, 110))):
            z = rng.uniform(crown_low, 0.95 * h)
            t = (z - crown_low) / max(h - crown_low, 1e-3)
            out = reach * (0.25 + 0.65 * np.sin(np.pi * (0.15 + 0.75 * t))) * rng.uniform(0.15, 0.95)
            a = i * 2.4 + rng.normal(0, 0.4)
            paint, root, turn = green(), (out * np.cos(a), out * np.sin(a), z), a + rng.normal(0, 0.7)
            kit.leaf(paint, root, turn, 0.06 + 0.16 * reach, 0.04 + 0.1 * reach, rng.uniform(-0.2, 0.7), 0.9, 2)
        for i in range(8):
            a, z = i * 2.4, crown_low + (0.85 * h - crown_low) * i / 8
            tip = (0.5 * reach * np.cos(a), 0.5 * reach * np.sin(a), z + 0.12 * (h - base))
            kit.tube(bark, [(0, 0, z), tip], [0.008, 0.003], sides=4)
