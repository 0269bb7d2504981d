"""Cabinets with drawers and doors."""

import numpy as np

from sbm_gym.assets.parametric.furniture.shelves import book_row
from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, with_halves

Span = tuple[float, float]


def drawers(kit: Kit, rng, paint, across, height, front: float, columns: int, rows: int, doors: bool = False) -> None:
    """Drawer or door fronts with gaps and handles on a cabinet's front, which lies at ``y = front``."""
    (x0, x1), (z0, z1) = across, height
    face = paints.darker(paint, float(rng.choice([1.0, 1.06, 0.93])))
    grip = paints.metal(rng)
    style = int(rng.integers(3))
    for i in range(columns):
        for j in range(rows):
            a, b = x0 + (x1 - x0) * i / columns + 0.006, x0 + (x1 - x0) * (i + 1) / columns - 0.006
            c, e = z0 + (z1 - z0) * j / rows + 0.006, z0 + (z1 - z0) * (j + 1) / rows - 0.006
            kit.box(face, (a, front - 0.018, c), (b, front + 0.005, e), bevel=0.003)
            mx, mz = 0.5 * (a + b), 0.5 * (c + e)
            if doors:
                mx = b - 0.04 if i < columns / 2 and columns > 1 else a + 0.04
                mz = float(np.clip(1.0, c + 0.12, e - 0.12)) if e - c > 0.5 else mz
            y = front - 0.018
            if style == 0:
                heights = [mz - 0.013, mz - 0.008, mz + 0.008, mz + 0.013]
                kit.lathe(grip, [0, 0.013, 0.013, 0], heights, (mx, y - 0.012), sides=8)
            elif doors:
                kit.box(grip, (mx - 0.006, y - 0.024, mz - 0.07), (mx + 0.006, y - 0.01, mz + 0.07))
                for z in (mz - 0.06, mz + 0.06):
                    kit.box(grip, (mx - 0.005, y - 0.012, z - 0.005), (mx + 0.005, y, z + 0.005))
            else:
                half = min(0.06, 0.25 * (b - a))
                kit.box(grip, (mx - half, y - 0.024, mz - 0.006), (mx + half, y - 0.01, mz + 0.006))
                for x in (mx - half + 0.01, mx + half - 0.01):
                    kit.box(grip, (x - 0.005, y - 0.012, mz - 0.005), (x + 0.005, y, mz + 0.005))


def _carcass(kit: Kit, rng, paint, size: Size, foot: float) -> tuple[Span, Span, float]:
    """The body of a cabinet on a plinth or legs; returns where its front is: across, in height, and its y."""
    w, d, h, hw, hd = with_halves(size)
    front = -hd + 0.045
    if foot > 0.06:
        legs = paints.wood(rng) if rng.random() < 0.5 else paints.metal(rng)
        with kit.placed((0, 0.02, 0)):
            kit.legs(legs, w - 0.04, d - 0.06, foot + 0.005, 0.035, int(rng.integers(2)))
    else:
        kit.box(paints.darker(paint, 0.5), (-hw + 0.02, front + 0.03, 0), (hw - 0.02, hd, foot))
    kit.box(paint, (-hw + 0.005, front, foot), (hw - 0.005, hd, h - 0.022))
    top = paint if rng.random() < 0.7 else paints.wood(rng)
    kit.box(top, (-hw, -hd, h - 0.024), (hw, hd, h), bevel=0.004)
    return (-hw + 0.01, hw - 0.01), (foot + 0.005, h - 0.028), front


def nightstand(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A small cabinet beside a bed: drawers, or a drawer over an open shelf."""
    w, d, h, hw, hd = with_halves(size)
    paint = paints.wood_or_board(rng, 0.7)
    foot = float(rng.choice([0.03, 0.1, 0.16]))
    if rng.random() < 0.4:
        kit.legs(paint, w, d, h - 0.02, 0.035, 0)
        kit.box(paint, (-hw, -hd, h - 0.024), (hw, hd, h), bevel=0.004)
        kit.box(paint, (-hw + 0.01, -hd + 0.03, h - 0.2), (hw - 0.01, hd - 0.005, h - 0.024))
        drawers(kit, rng, paint, (-hw + 0.03, hw - 0.03), (h - 0.19, h - 0.03), -hd + 0.03, 1, 1)
        kit.box(paint, (-hw + 0.01, -hd + 0.02, 0.12), (hw - 0.01, hd - 0.01, 0.14))
        if rng.random() < 0.5:
            book_row(kit, rng, -hw + 0.06, hw - 0.08, -0.1, 0.08, 0.14, 0.1)
        return
    front = _carcass(kit, rng, paint, size, foot)
    drawers(kit, rng, paint, *front, 1, int(rng.integers(1, 4)))


def dresser(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A chest of drawers."""
    paint = paints.wood_or_board(rng, 0.7)
    front = _carcass(kit, rng, paint, size, float(rng.choice([0.04, 0.12])))
    drawers(kit, rng, paint, *front, 1 if size[0] < 0.85 else 2, int(rng.integers(3, 6)))


def tv_stand(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A low, wide cabinet."""
    paint = paints.wood_or_board(rng, 0.6)
    front = _carcass(kit, rng, paint, size, float(rng.choice([0.03, 0.1])))
    columns, rows = int(rng.integers(2, 4)), int(rng.integers(1, 3))
    drawers(kit, rng, paint, *front, columns, rows, doors=rng.random() < 0.4)


def cupboard(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A wardrobe with two to four doors."""
    paint = paints.wood_or_board(rng, 0.55)
    across, (low, high), front = _carcass(kit, rng, paint, size, 0.05)
    if rng.random() < 0.35:
        drawers(kit, rng, paint, across, (low, 0.3), front, 2, 1)
        low = 0.3
    drawers(kit, rng, paint, across, (low, high), front, max(2, round(size[0] / 0.5)), 1, doors=True)


def office_cabinet(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A filing cabinet."""
    _, _, h, hw, hd = with_halves(size)
    paint = paints.plain(np.full(3, rng.choice([0.25, 0.6, 0.8])), 0.3)
    kit.box(paint, (-hw, -hd + 0.04, 0), (hw, hd, h))
    drawers(kit, rng, paint, (-hw + 0.005, hw - 0.005), (0.03, h - 0.01), -hd + 0.04, 1, 4 if h > 1.1 else 3)
