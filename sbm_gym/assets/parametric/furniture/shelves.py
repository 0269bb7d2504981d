"""Open shelves and what stands on them."""

import itertools

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import CORNERS, Kit, Size, with_halves


def book_row(kit: Kit, rng, x0: float, x1: float, y0: float, y1: float, z: float, high: float) -> None:
    """Books from x0 to x1, their spines towards -Y."""
    row = paints.books(rng)
    top = z + high
    paper = paints.plain((0.85, 0.82, 0.74), 0.0)
    kit.picture(row, (x0, x1), (z, top), y0)
    top -= 0.02
    kit.card(paper, [(x0, y0, top), (x1, y0, top), (x1, y1, top), (x0, y1, top)])
    right = [(x1, y0, z), (x1, y1, z), (x1, y1, top), (x1, y0, top)]
    left = [(x0, y1, z), (x0, y0, z), (x0, y0, top), (x0, y1, top)]
    kit.card(row, right, [[0.97, 1], [1, 1], [1, 0.2], [0.97, 0.2]])
    kit.card(row, left, [[0, 1], [0.03, 1], [0.03, 0.2], [0, 0.2]])


def shelf(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """Open shelves with books and boxes: a bookcase, a frame of metal, or cubes."""
    w, d, h, hw, hd = with_halves(size)
    kind = int(rng.integers(3))
    paint = paints.wood_or_board(rng, 0.6)
    thick = 0.022
    rows = max(2, round(h / float(rng.uniform(0.3, 0.42))))
    columns = 1 if w < 0.7 else int(rng.integers(1, 1 + max(2, round(w / 0.4))))
    if kind == 2:
        columns, rows = max(1, round(w / 0.38)), max(2, round(h / 0.38))
    posts = paints.metal(rng) if kind == 1 else paint
    foot = 0.0 if kind == 2 else float(rng.choice([0.02, 0.07]))
    if kind == 1:
        for sx, sy in CORNERS:
            x, y = sx * (hw - 0.014), sy * (hd - 0.014)
            kit.box(posts, (x - 0.014, y - 0.014, 0), (x + 0.014, y + 0.014, h))
    else:
        for x in np.linspace(-hw + thick / 2, hw - thick / 2, columns + 1):
            kit.box(paint, (x - thick / 2, -hd, 0), (x + thick / 2, hd, h - thick if 0 < abs(x) < hw - thick else h))
    levels = np.linspace(foot, h - thick, rows + 1)
    for z in levels:
        kit.box(paint, (-hw + 0.004, -hd + 0.004, z), (hw - 0.004, hd - 0.004, z + thick))
    if kind != 1 and rng.random() < 0.6:
        kit.box(paints.darker(paint, 0.85), (-hw + thick, hd - 0.012, foot), (hw - thick, hd - 0.002, h - thick))
    cells = columns if kind != 1 else max(1, round(w / 0.6))
    for z, above in itertools.pairwise(levels):
        room = above - z - thick
        for i in range(cells):
            x0, x1 = -hw + w * i / cells + 0.025, -hw + w * (i + 1) / cells - 0.025
            what = rng.random()
            base = float(z) + thick
            if what < 0.55:
                share = float(rng.uniform(0.4, 1.0))
                a = x0 if rng.random() < 0.5 else x1 - share * (x1 - x0)
                b, high = a + share * (x1 - x0), float(rng.uniform(0.6, 0.9)) * room
                book_row(kit, rng, a, b, -hd + 0.04, hd - 0.05, base, high)
            elif what < 0.72:
                box = paints.fabric(rng, 0.2) if rng.random() < 0.5 else paints.board(rng)
                top = base + float(rng.uniform(0.5, 0.85)) * room
                kit.box(box, (x0 + 0.01, -hd + 0.02, base), (x1 - 0.01, hd - 0.04, top), bevel=0.006)
            elif what < 0.88:
                r = min(0.07, 0.3 * (x1 - x0), 0.3 * d)
                high = float(rng.uniform(0.5, 0.85)) * room
                x = float(rng.uniform(x0 + r, x1 - r))
                heights = [base, base, base + 0.45 * high, base + 0.8 * high, base + high, base + high - 0.01]
                kit.lathe(paints.board(rng), [0, 0.6 * r, r, 0.45 * r, 0.55 * r, 0], heights, (x, 0), sides=12)
