"""Tables and desks."""

import numpy as np

from sbm_gym.assets.parametric.furniture.cabinets import drawers
from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, circle, with_halves


def dining_table(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A table: rectangular or round, on legs, a pedestal or two frames."""
    w, d, h, hw, hd = with_halves(size)
    top = paints.wood_or_board(rng, 0.7)
    legs = top if rng.random() < 0.5 else (paints.metal(rng) if rng.random() < 0.5 else paints.board(rng))
    thick = float(rng.uniform(0.02, 0.045))
    round_top = abs(w - d) < 0.02 and rng.random() < 0.75
    if round_top:
        kit.prism(top, circle((0.0, 0.0), (hw, hd), 28), 2, h - thick, h)
    else:
        kit.box(top, (-hw, -hd, h - thick), (hw, hd, h), bevel=0.006)
    kind = int(rng.integers(4))
    if round_top and kind < 3:
        r = 0.28 * w
        heights = [0, 0, 0.02, 0.06, 0.12, h - 0.2, h - thick, h - thick]
        kit.lathe(legs, [0, r, r, 0.06, 0.04, 0.035, 0.1, 0], heights, sides=18)
    elif kind == 3 and not round_top:
        for x in (-0.5 * w + 0.12, 0.5 * w - 0.12):
            kit.box(legs, (x - 0.04, -0.42 * d, 0), (x + 0.04, 0.42 * d, 0.04), bevel=0.006)
            kit.box(legs, (x - 0.03, -0.06, 0.04), (x + 0.03, 0.06, h - 0.05), bevel=0.006)
            kit.box(legs, (x - 0.04, -0.4 * d, h - 0.08), (x + 0.04, 0.4 * d, h - thick), bevel=0.006)
        kit.box(legs, (-0.5 * w + 0.12, -0.03, 0.3), (0.5 * w - 0.12, 0.03, 0.4))
    else:
        reach = 0.72 if round_top else 1.0
        post = float(rng.uniform(0.04, 0.09))
        kit.legs(legs, reach * w, reach * d, h - thick, post, int(rng.integers(3)), inset=0.01)
        if kind != 1 and not round_top:
            side, end = hw - post / 2 - 0.02, hd - post / 2 - 0.02
            for y in (-end, end):
                kit.box(legs, (-hw + post, y - 0.01, h - thick - 0.09), (hw - post, y + 0.01, h - thick))
            for x in (-side, side):
                kit.box(legs, (x - 0.01, -hd + post, h - thick - 0.09), (x + 0.01, hd - post, h - thick))


def coffee_table(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A low table, often with a board below."""
    w, d, h, hw, hd = with_halves(size)
    top = paints.wood_or_board(rng, 0.65)
    legs = top if rng.random() < 0.5 else paints.metal(rng)
    thick = float(rng.uniform(0.02, 0.05))
    if abs(w - d) < 0.02:
        kit.prism(top, circle((0.0, 0.0), (hw, hd), 28), 2, h - thick, h)
        if rng.random() < 0.3:
            kit.lathe(top, [0, 0.35 * w, 0.35 * w, 0], [0, 0, h - thick, h - thick], sides=20)
        else:
            kit.legs(legs, 0.75 * w, 0.75 * d, h - thick, 0.04, int(rng.integers(1, 3)))
        return
    kit.box(top, (-hw, -hd, h - thick), (hw, hd, h), bevel=0.006)
    if rng.random() < 0.25:
        for x in (-hw + 0.04, hw - 0.04):
            kit.box(top, (x - 0.025, -hd + 0.02, 0), (x + 0.025, hd - 0.02, h - thick))
    else:
        kit.legs(legs, w, d, h - thick, float(rng.uniform(0.035, 0.07)), int(rng.integers(3)), inset=0.015)
    if rng.random() < 0.6:
        kit.box(top, (-hw + 0.06, -hd + 0.06, 0.12), (hw - 0.06, hd - 0.06, 0.14))


def desk(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A desk: a top on legs or trestles, with or without a chest of drawers at one side; one sits before its front."""
    w, d, h, hw, hd = with_halves(size)
    top = paints.wood_or_board(rng, 0.55)
    body = top if rng.random() < 0.6 else paints.board(rng)
    legs = paints.metal(rng) if rng.random() < 0.5 else body
    kit.box(top, (-hw, -hd, h - 0.028), (hw, hd, h), bevel=0.004)
    kind = int(rng.integers(3))
    if kind == 0:
        kit.legs(legs, w, d, h - 0.028, 0.05, int(rng.integers(2)), inset=0.02)
        kit.box(body, (-hw + 0.07, hd - 0.05, h - 0.3), (hw - 0.07, hd - 0.03, h - 0.028))
        return
    sides = (-1, 1) if kind == 2 and w > 1.3 else (int(rng.choice([-1, 1])),)
    for sx in (-1, 1):
        if sx in sides:
            x0, x1 = sorted((sx * (hw - 0.02), sx * (hw - 0.02 - min(0.4, 0.32 * w))))
            kit.box(body, (x0, -hd + 0.035, 0), (x1, hd - 0.02, h - 0.028))
            drawers(kit, rng, body, (x0, x1), (0.05, h - 0.04), -hd + 0.035, 1, int(rng.integers(2, 5)))
        else:
            x = sx * (hw - 0.035)
            kit.box(body, (x - 0.014, -hd + 0.03, 0), (x + 0.014, hd - 0.02, h - 0.028))
    kit.box(body, (-hw + 0.05, hd - 0.06, 0.3), (hw - 0.05, hd - 0.04, h - 0.028))
