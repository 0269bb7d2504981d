"""Fitted kitchens: base cabinets, sinks and wall cabinets of one make share fronts, worktop, grips and sizes."""

import itertools
from dataclasses import dataclass

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.paints import Paint
from sbm_gym.assets.builtin_models.shapes import Kit, Size

MODULES_M = (0.45, 0.6, 0.8)
"""Widths that cabinets come in."""
TAP_M = 0.24
PLINTH_M = 0.1
WORKTOP_M = 0.036
_FRONT_M = 0.02
"""Thickness of doors and drawer fronts."""


@dataclass(frozen=True)
class KitchenStyle:
    """What all cabinets of one kitchen share."""

    front: Paint
    body: Paint
    worktop: Paint
    grip: Paint
    knobs: bool
    framed: bool
    """Whether fronts have a frame around a panel, or are plain."""
    depth_m: float
    height_m: float
    """Of the worktop."""
    wall_depth_m: float
    wall_height_m: float
    glazed: float
    """Share of the wall cabinets that have glass doors."""


def draw_style(rng: np.random.Generator) -> KitchenStyle:
    """Draws a kitchen."""
    body = paints.plain((0.88, 0.88, 0.86), 0.15)
    front = paints.wood(rng) if rng.random() < 0.4 else paints.board(rng)
    stones = ((0.16, 0.16, 0.17), (0.45, 0.44, 0.43), (0.74, 0.72, 0.68), (0.86, 0.85, 0.83))
    stone = paints.plain(stones[rng.integers(len(stones))], 0.4, 0.6)
    wooden_top = front.texture is None and rng.random() < 0.6
    return KitchenStyle(
        front=front,
        body=body if front.texture is None else front,
        worktop=paints.wood(rng) if wooden_top else stone,
        grip=paints.metal(rng),
        knobs=bool(rng.random() < 0.35),
        framed=bool(rng.random() < 0.5),
        depth_m=round(float(rng.uniform(0.60, 0.64)), 3),
        height_m=round(float(rng.uniform(0.88, 0.92)), 3),
        wall_depth_m=round(float(rng.uniform(0.32, 0.37)), 3),
        wall_height_m=round(float(rng.uniform(0.66, 0.76)), 3),
        glazed=float(rng.choice([0.0, 0.0, 0.4])),
    )


def base_size(size: Size, style: KitchenStyle) -> Size:
    """The size of a base cabinet."""
    return _module(size[0]), style.depth_m, style.height_m


def sink_size(size: Size, style: KitchenStyle) -> Size:
    """The size of a cabinet with a sink and its tap."""
    return max(_module(size[0]), MODULES_M[1]), style.depth_m, round(style.height_m + TAP_M, 3)


def wall_size(size: Size, style: KitchenStyle) -> Size:
    """The size of a wall cabinet."""
    return _module(size[0]), style.wall_depth_m, style.wall_height_m


def _module(width_m: float) -> float:
    return min(MODULES_M, key=lambda module: abs(module - width_m))


def base_cabinet(kit: Kit, rng: np.random.Generator, size: Size, style: KitchenStyle) -> None:
    """A base cabinet with its piece of worktop: doors, drawers, or a drawer over doors."""
    w, d, h = size
    face = _carcass(kit, style, size, h - WORKTOP_M)
    kit.box(style.worktop, (-w / 2, -d / 2, h - WORKTOP_M), (w / 2, d / 2, h))
    low, high = PLINTH_M + 0.003, h - WORKTOP_M - 0.004
    columns = 2 if w > 0.7 else 1
    kind = int(rng.integers(3))
    if kind == 0:
        levels = [low, low + 0.42 * (high - low), low + 0.78 * (high - low), high]
        for a, b in itertools.pairwise(levels):
            _front(kit, style, (-w / 2, w / 2), (a, b), face, "drawer")
        return
    split = high - 0.16 if kind == 1 else high
    for column in range(columns):
        across = (-w / 2 + w * column / columns, -w / 2 + w * (column + 1) / columns)
        hinge = "left" if (columns == 2 and column == 0) or (columns == 1 and rng.random() < 0.5) else "right"
        _front(kit, style, across, (low, split), face, hinge)
        if kind == 1:
            _front(kit, style, across, (split, high), face, "drawer")


def sink_cabinet(kit: Kit, rng: np.random.Generator, size: Size, style: KitchenStyle) -> None:
    """A base cabinet with a sink let into its worktop, and a tap."""
    w, d, total = size
    h = total - TAP_M
    deep = h - 0.19
    face = _carcass(kit, style, size, deep)
    # Around the bowl the cabinet goes on up to the worktop.
    for low, high in (
        ((-w / 2, face, deep), (w / 2, face + 0.03, h - WORKTOP_M)),
        ((-w / 2, d / 2 - 0.03, deep), (w / 2, d / 2, h - WORKTOP_M)),
        ((-w / 2, face + 0.03, deep), (-w / 2 + 0.016, d / 2 - 0.03, h - WORKTOP_M)),
        ((w / 2 - 0.016, face + 0.03, deep), (w / 2, d / 2 - 0.03, h - WORKTOP_M)),
    ):
        kit.box(style.body, low, high)
    half, front, back = min(0.36 * w, 0.27), -0.30 * d, 0.22 * d
    for low, high in (
        ((-w / 2, -d / 2), (w / 2, front)),
        ((-w / 2, back), (w / 2, d / 2)),
        ((-w / 2, front), (-half, back)),
        ((half, front), (w / 2, back)),
    ):
        kit.box(style.worktop, (*low, h - WORKTOP_M), (*high, h))
    bowl = paints.CERAMIC if rng.random() < 0.3 else paints.STEEL
    floor = h - 0.17
    x0, x1, y0, y1 = -half, half, front, back
    rim = [((x0 - 0.015, y0 - 0.015), (x1 + 0.015, y0)), ((x0 - 0.015, y1), (x1 + 0.015, y1 + 0.015))]
    rim += [((x0 - 0.015, y0), (x0, y1)), ((x1, y0), (x1 + 0.015, y1))]
    for low, high in rim:
        kit.box(bowl, (*low, h - 0.004), (*high, h + 0.003))
    inside = paints.darker(bowl, 0.85)
    kit.card(inside, [(x0, y0, floor), (x1, y0, floor), (x1, y1, floor), (x0, y1, floor)])
    kit.card(inside, [(x1, y0, floor), (x0, y0, floor), (x0, y0, h), (x1, y0, h)])
    kit.card(inside, [(x0, y1, floor), (x1, y1, floor), (x1, y1, h), (x0, y1, h)])
    kit.card(inside, [(x0, y0, floor), (x0, y1, floor), (x0, y1, h), (x0, y0, h)])
    kit.card(inside, [(x1, y1, floor), (x1, y0, floor), (x1, y0, h), (x1, y1, h)])
    kit.lathe(paints.BLACK, [(0.03, floor + 0.001), (0, floor + 0.002)], (0.0, 0.5 * (y0 + y1)), sides=10)
    y = back + 0.06
    neck = [(0, y, h - 0.01), (0, y, h + 0.75 * TAP_M), (0, y - 0.05, total - 0.012), (0, y - 0.15, h + 0.75 * TAP_M)]
    kit.tube(paints.CHROME, neck, 0.012, sides=8)
    kit.tube(paints.CHROME, [(0.0, y, h + 0.05), (0.07, y, h + 0.08)], 0.008, sides=6)
    columns = 2 if w > 0.7 else 1
    for column in range(columns):
        across = (-w / 2 + w * column / columns, -w / 2 + w * (column + 1) / columns)
        hinge = "left" if columns == 2 and column == 0 else "right"
        _front(kit, style, across, (PLINTH_M + 0.003, h - WORKTOP_M - 0.004), face, hinge)


def wall_cabinet(kit: Kit, rng: np.random.Generator, size: Size, style: KitchenStyle) -> None:
    """A cabinet that hangs above a worktop: doors, sometimes of glass."""
    w, d, h = size
    face = -d / 2 + _FRONT_M
    columns = 2 if w > 0.7 else 1
    glazed = rng.random() < style.glazed
    if glazed:
        board = 0.018
        kit.box(style.body, (-w / 2, d / 2 - 0.01, 0), (w / 2, d / 2, h))
        for x in (-w / 2, w / 2 - board):
            kit.box(style.body, (x, face, 0), (x + board, d / 2 - 0.01, h))
        for z in (0.0, 0.5 * h, h - board):
            kit.box(style.body, (-w / 2 + board, face + 0.004, z), (w / 2 - board, d / 2 - 0.01, z + board))
        for x in np.arange(-w / 2 + 0.08, w / 2 - 0.06, 0.11):
            high = float(rng.uniform(0.07, 0.16))
            for z in (board, 0.5 * h + board):
                kit.lathe(paints.CERAMIC, [(0, z), (0.03, z), (0.042, z + high), (0, z + high)], (float(x), 0.0), 10)
    else:
        kit.box(style.body, (-w / 2, face, 0), (w / 2, d / 2, h))
    for column in range(columns):
        across = (-w / 2 + w * column / columns, -w / 2 + w * (column + 1) / columns)
        hinge = "left" if columns == 2 and column == 0 else "right"
        _front(kit, style, across, (0.0, h), face, hinge, grip_low=True, glazed=glazed)


def _carcass(kit: Kit, style: KitchenStyle, size: Size, top: float) -> float:
    """The body of a base cabinet on its plinth; returns the y of the plane that its fronts lie on."""
    w, d, _ = size
    face = -d / 2 + 0.045
    kit.box(paints.darker(style.front, 0.45), (-w / 2, face + 0.04, 0), (w / 2, d / 2, PLINTH_M))
    kit.box(style.body, (-w / 2, face, PLINTH_M), (w / 2, d / 2, top))
    return face


def _front(
    kit: Kit,
    style: KitchenStyle,
    across: tuple[float, float],
    height: tuple[float, float],
    face: float,
    kind: str,
    grip_low: bool = False,
    glazed: bool = False,
) -> None:
    """A door, hinged ``left`` or ``right``, or the front of a ``drawer``, with its grip."""
    x0, x1, z0, z1 = across[0] + 0.002, across[1] - 0.002, height[0] + 0.0015, height[1] - 0.0015
    y = face - _FRONT_M
    edge = 0.055
    if glazed or (style.framed and min(x1 - x0, z1 - z0) > 3 * edge):
        for low, high in (((x0, z0), (x1, z0 + edge)), ((x0, z1 - edge), (x1, z1))):
            kit.box(style.front, (low[0], y, low[1]), (high[0], face, high[1]))
        for a in (x0, x1 - edge):
            kit.box(style.front, (a, y, z0 + edge), (a + edge, face, z1 - edge))
        if glazed:
            pane = [(x0 + edge, z0 + edge), (x1 - edge, z0 + edge), (x1 - edge, z1 - edge), (x0 + edge, z1 - edge)]
            kit.card(paints.GLASS, [(x, y + 0.01, z) for x, z in pane])
        else:
            kit.box(style.front, (x0 + edge, y + 0.009, z0 + edge), (x1 - edge, face, z1 - edge))
    else:
        kit.box(style.front, (x0, y, z0), (x1, face, z1), bevel=0.002)
    if kind == "drawer":
        x, z = 0.5 * (x0 + x1), (z1 - 0.05 if z1 - z0 > 0.2 else 0.5 * (z0 + z1))
        half = min(0.08, 0.3 * (x1 - x0))
        ends = [(x - half, z), (x + half, z)]
    else:
        x = x1 - 0.035 if kind == "left" else x0 + 0.035
        z = z0 + 0.09 if grip_low else z1 - 0.09
        ends = [(x, z - 0.06), (x, z + 0.06)]
    if style.knobs:
        x, z = 0.5 * (ends[0][0] + ends[1][0]), 0.5 * (ends[0][1] + ends[1][1])
        kit.box(style.grip, (x - 0.013, y - 0.022, z - 0.013), (x + 0.013, y, z + 0.013), bevel=0.006)
        return
    (a, c), (b, e) = ends
    kit.box(style.grip, (a - 0.005, y - 0.022, c - 0.005), (b + 0.005, y - 0.012, e + 0.005))
    for x, z in ends:
        kit.box(style.grip, (x - 0.004, y - 0.013, z - 0.004), (x + 0.004, y, z + 0.004))
