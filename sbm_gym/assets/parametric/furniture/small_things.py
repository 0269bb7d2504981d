"""Rugs, radiators, bins, and what stands on tables and desks."""

import numpy as np

from sbm_gym.assets.models import surfaces
from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, turn_z, with_halves


def rug(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A rug."""
    _, _, h, hw, hd = with_halves(size)
    picture = surfaces.rug(rng)
    top = [(-hw, -hd, h), (hw, -hd, h), (hw, hd, h), (-hw, hd, h)]
    kit.card(paints.Paint(texture=picture, tile_m=None), top)
    kit.box(paints.plain(picture[0, 0] / 255.0, 0.0), (-hw, -hd, 0), (hw, hd, 0.8 * h))


def radiator(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A radiator: a ribbed panel or a row of columns."""
    w, d, h, hw, hd = with_halves(size)
    white = paints.plain((0.92, 0.92, 0.9), 0.25)
    if rng.random() < 0.5:
        kit.box(white, (-hw, -hd, 0.08), (hw, hd - 0.02, h), bevel=0.006)
        for x in np.arange(-hw + 0.04, hw - 0.02, 0.05):
            kit.box(white, (x - 0.012, -hd - 0.006, 0.13), (x + 0.012, -hd + 0.004, h - 0.04), bevel=0.004)
    else:
        for x in np.linspace(-hw + 0.03, hw - 0.03, max(4, round(w / 0.065))):
            kit.box(white, (x - 0.024, -hd, 0.09), (x + 0.024, hd - 0.02, h), bevel=0.02)
    for x in (-0.4 * w, 0.4 * w):
        kit.box(white, (x - 0.015, -0.2 * d, 0), (x + 0.015, hd, 0.14))


def waste_bin(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bin, open or with a domed lid."""
    w, _, h = size
    paint = paints.metal(rng) if rng.random() < 0.5 else paints.board(rng)
    r = w / 2
    if rng.random() < 0.5:
        kit.lathe(paint, [0, 0.75 * r, r, 0.96 * r, 0.72 * r, 0], [0, 0, h, h, 0.02, 0.02], sides=20)
    else:
        kit.lathe(paint, [0, 1, 1, 0.97, 0.85, 0.45, 0], [0, 0, 0.78, 0.8, 0.92, 0.985, 1], sides=20, scale=(r, h))


def table_thing(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A vase, a bowl with fruit, a bottle or a cup."""
    w, _, h = size
    r = w / 2
    paint = paints.plain(rng.uniform(0.15, 0.9, 3), 0.5, 0.6)
    if h > 0.2 and rng.random() < 0.5:
        radii, heights = [0, 0.6, 1, 0.8, 0.4, 0.5, 0.42, 0.3, 0], [0, 0, 0.35, 0.65, 0.85, 1, 1, 0.85, 0.8]
        kit.lathe(paint, radii, heights, sides=18, scale=(r, h))
    elif h > 0.2:
        radii, heights = [0, 1, 1, 0.35, 0.33, 0.38, 0.38, 0], [0, 0, 0.6, 0.74, 0.97, 0.975, 1, 1]
        kit.lathe(paint, radii, heights, sides=16, scale=(r, h))
    else:
        kit.lathe(paint, [0, 0.4, 0.75, 1, 0.96, 0.7, 0], [0, 0, 0.35, 0.75, 0.75, 0.36, 0.15], sides=18, scale=(r, h))
        tones = ((0.75, 0.15, 0.1), (0.9, 0.55, 0.1), (0.5, 0.65, 0.15), (0.92, 0.8, 0.2))
        for i in range(4):
            fruit = paints.plain(tones[rng.integers(4)], 0.2)
            a, f = i * 1.6, 0.33 * r
            kit.ball(fruit, (0.42 * r * np.cos(a), 0.42 * r * np.sin(a), h - f), f, f)


def desk_thing(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A pile of books or papers, or a cup of pens."""
    w, d, h, hw, hd = with_halves(size)
    if rng.random() < 0.6:
        z, count = 0.0, int(rng.integers(2, 5))
        for i in range(count):
            top = h * (i + 1) / count
            paint = paints.plain(rng.uniform(0.1, 0.85, 3), 0.1)
            with kit.placed(rotation=turn_z(0.0 if i == 0 else float(rng.normal(0, 0.12)))):
                x, y = (hw, hd) if i == 0 else (0.82 * hw, 0.82 * hd)
                kit.box(paint, (-x, -y, z), (x, y, z + 0.003))
                kit.box(paint, (-x, -y, top - 0.003), (x, y, top))
                pages = paints.plain((0.9, 0.88, 0.82), 0.0)
                kit.box(pages, (-x + 0.004, -y + 0.003, z + 0.003), (x - 0.004, y - 0.003, top - 0.003))
                kit.box(paint, (-x, y - 0.004, z), (x, y, top))
            z = top
        return
    r = 0.3 * min(w, d)
    kit.lathe(paints.board(rng), [0, 1, 1, 0.9, 0.9, 0], [0, 0, 0.65, 0.65, 0.1, 0.1], sides=14, scale=(r, h))
    for i in range(5):
        a = i * 1.26
        pen, tip = paints.plain(rng.uniform(0.05, 0.9, 3), 0.2), (0.95 * hw * np.cos(a), 0.95 * hd * np.sin(a), h)
        kit.tube(pen, [(0.2 * r * np.cos(a), 0.2 * r * np.sin(a), 0.1 * h), tip], 0.004, sides=5)
