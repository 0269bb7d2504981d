"""Couches and armchairs: upholstered all over in several manners, or cushions in a wooden frame."""

import itertools
from typing import NamedTuple

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.paints import Paint
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, circle, turn_x, with_halves

CHAISE_DEPTH_M = 1.2
"""Couches deeper than this are L-shaped: one seat goes on to the front."""
_ARMS = ("block", "rolled", "slim", "sloped")
_BACKS = ("cushions", "cushions", "channels", "buttons")


def couch_size(size: Size) -> Size:
    """Wide couches are L-shaped."""
    width, depth, height = size
    return width, round(depth + 0.62, 3) if width > 2.2 else depth, height


def couch(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A couch of two or three seats, L-shaped where it is deep."""
    if size[1] < CHAISE_DEPTH_M and rng.random() < 0.22:
        _framed(kit, rng, size, 2 if size[0] < 1.8 else 3)
    else:
        _upholstered(kit, rng, size)


def lounge_chair(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """An armchair, upholstered all over or with cushions in a wooden frame."""
    if rng.random() < 0.6:
        _upholstered(kit, rng, size)
    else:
        _framed(kit, rng, size, 1)


class _Frame(NamedTuple):
    """Where the parts of an upholstered couch are: y of the fronts of seats and of its rear, heights, thickness."""

    front: float
    behind: float
    low: float
    seat: float
    arm_top: float
    back: float
    top: float


def _upholstered(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    w, d, h, hw, hd = with_halves(size)
    single = w < 1.2
    cover = paints.upholstery(rng)
    low = float(rng.choice([0.03, 0.09, 0.14, 0.17]))
    arms = str(rng.choice(_ARMS))
    wide = {"block": (0.14, 0.24), "rolled": (0.15, 0.21), "slim": (0.06, 0.09), "sloped": (0.10, 0.16)}[arms]
    arm = float(rng.uniform(*wide)) * (0.75 if single else 1.0)
    seat = float(rng.uniform(0.40, 0.46))
    chaise = d > CHAISE_DEPTH_M
    deep = d - 0.62 if chaise else d
    arm_top = float(rng.uniform(seat + 0.1, min(h - 0.07, seat + 0.26)))
    frame = _Frame(hd - deep, hd, low, seat, arm_top, back=float(rng.uniform(0.16, 0.24)), top=h)
    side = int(rng.choice([-1, 1]))
    left, right = -hw + arm, hw - arm
    count = 1 if single else 2 if w < 1.75 or rng.random() < 0.3 else 3
    edges = np.linspace(left, right, count + 1)
    if chaise:
        long = float(rng.uniform(0.62, 0.76))
        rest = max(round((right - left - long) / 0.7), 1)
        edges = np.append(np.linspace(left, right - long, rest + 1), right)
        edges = edges if side > 0 else -edges[::-1]
    # Which seat goes on to the front; none of a straight couch.
    lying = (len(edges) - 2 if side > 0 else 0) if chaise else -1
    kit.box(cover, (-hw + 0.02, frame.front + 0.03, low), (hw - 0.02, hd - 0.02, seat - 0.12), bevel=0.02)
    for sx in (-1, 1):
        _arm(kit, cover, frame, arms, sx, arm, w, 0.0 if lying < 0 or sx != side else 0.35 * deep)
    high = h - float(rng.uniform(0.0, 0.05))
    kit.box(cover, (-hw + 0.02, hd - frame.back, low), (hw - 0.02, hd, high), bevel=0.05, puff=0.006)
    _seats(kit, rng, cover, frame, edges, lying)
    _backrest(kit, rng, cover, frame, edges)
    feet = [(sx * (hw - 0.09), y) for sx in (-1, 1) for y in (frame.front + 0.08, hd - 0.08)]
    if chaise:
        x0, x1 = edges[lying], edges[lying + 1]
        kit.box(cover, (x0 + 0.01, -hd + 0.02, low), (x1 - 0.01, frame.front + 0.1, seat - 0.12), bevel=0.02)
        feet += [(x, -hd + 0.09) for x in (x0 + 0.08, x1 - 0.08)]
        kit.footprint = [(-hw, frame.front, hw, hd), (float(x0), -hd, float(x1), frame.front)]
    _feet(kit, rng, feet, low)


def _arm(kit: Kit, cover: Paint, f: _Frame, kind: str, sx: int, arm: float, w: float, shorter: float) -> None:
    """One arm; beside a chaise it ends before the seat does."""
    x0, x1 = sorted((sx * (w / 2 - arm), sx * w / 2))
    front, back = f.front + shorter, f.behind - 0.03
    if kind == "rolled":
        r = arm / 2
        kit.box(cover, (x0 + 0.2 * arm, front + 0.01, f.low), (x1 - 0.2 * arm, back, f.arm_top - r), bevel=0.01)
        roll = [(z, x) for x, z in circle((0.5 * (x0 + x1), f.arm_top - r), r, 14)]
        kit.prism(cover, roll[::-1], 1, front, back)
    elif kind == "sloped":
        side = [(front, f.low), (back, f.low), (back, f.top - 0.03), (back - 0.3, f.arm_top), (front, f.arm_top - 0.06)]
        kit.prism(cover, side, 0, x0, x1)
    else:
        bevel = min(0.05, 0.35 * arm)
        kit.box(cover, (x0, front, f.low), (x1, back, f.arm_top), bevel=bevel, puff=0.008)


def _seats(kit: Kit, rng: np.random.Generator, cover: Paint, f: _Frame, edges: np.ndarray, lying: int) -> None:
    """Seat cushions; now and then one long one."""
    back = f.behind - f.back + 0.03
    joined = lying < 0 and len(edges) > 2 and rng.random() < 0.25
    spans = [(edges[0], edges[-1])] if joined else list(itertools.pairwise(edges))
    for index, (x0, x1) in enumerate(spans):
        y0 = -f.behind if index == lying else f.front + 0.005
        kit.box(cover, (x0 + 0.003, y0, f.seat - 0.14), (x1 - 0.003, back, f.seat), bevel=0.035, puff=0.02)


def _backrest(kit: Kit, rng: np.random.Generator, cover: Paint, f: _Frame, edges: np.ndarray) -> None:
    """What one leans on: loose cushions, upright channels, or a padded back with buttons."""
    kind = str(rng.choice(_BACKS))
    lean = float(rng.uniform(0.08, 0.2))
    top = (f.top - f.seat + 0.01) / np.cos(lean)
    x0, x1 = float(edges[0]), float(edges[-1])
    with kit.placed((0.0, f.behind - f.back + 0.02, f.seat - 0.01), turn_x(-lean)):
        if kind == "channels":
            count = max(round((x1 - x0) / 0.15), 4)
            for a, b in itertools.pairwise(np.linspace(x0, x1, count + 1)):
                kit.box(cover, (a + 0.001, -0.12, 0), (b - 0.001, 0, top - 0.02), bevel=0.045)
        elif kind == "buttons":
            kit.box(cover, (x0 + 0.004, -0.11, 0), (x1 - 0.004, 0, top - 0.02), bevel=0.045, puff=0.012)
            button = paints.darker(cover, 0.7)
            columns = max(round((x1 - x0) / 0.22), 2)
            for row, z in enumerate((0.36 * top, 0.66 * top)):
                for i in range(columns - row):
                    x = x0 + (x1 - x0) * (i + 0.5 + 0.5 * row) / columns
                    kit.prism(button, circle((z, x), 0.016, 8), 1, -0.115, -0.1)
        else:
            gap = float(rng.uniform(0.004, 0.02))
            for a, b in itertools.pairwise(edges):
                kit.box(cover, (a + gap, -0.16, 0), (b - gap, 0, top - 0.03), bevel=0.05, puff=0.03)


def _feet(kit: Kit, rng: np.random.Generator, places: list[tuple[float, float]], high: float) -> None:
    """Turned wooden feet, square ones, or thin rods of metal."""
    kind = int(rng.integers(3))
    paint = paints.metal(rng) if kind == 2 else paints.wood(rng)
    for x, y in places:
        if kind == 1:
            kit.box(paint, (x - 0.025, y - 0.025, 0), (x + 0.025, y + 0.025, high + 0.01))
        else:
            r = 0.016 if kind == 0 else 0.011
            kit.lathe(paint, [0, r, 1.6 * r, 0], [0, 0, high + 0.01, high + 0.01], (x, y), sides=8)


def _framed(kit: Kit, rng: np.random.Generator, size: Size, seats: int) -> None:
    """Cushions in a wooden frame."""
    _, _, h, hw, hd = with_halves(size)
    frame, cover = paints.wood(rng), paints.fabric(rng, 0.25)
    seat, post = 0.42, 0.045
    arm_top = float(rng.uniform(0.54, 0.62))
    for x in (-hw + post / 2, hw - post / 2):
        for y in (-hd + 0.04, hd - 0.16):
            kit.box(frame, (x - post / 2, y - post / 2, 0), (x + post / 2, y + post / 2, arm_top), bevel=0.006)
        kit.box(frame, (x - 0.035, -hd, arm_top - 0.005), (x + 0.035, hd - 0.08, arm_top + 0.025), bevel=0.01)
        kit.box(frame, (x - 0.015, -hd + 0.04, 0.24), (x + 0.015, hd - 0.16, 0.3))
    for y in (-hd + 0.05, hd - 0.2):
        kit.box(frame, (-hw + post, y - 0.015, 0.24), (hw - post, y + 0.015, 0.31))
    half = hw - post - 0.01
    edges = np.linspace(-half, half, seats + 1)
    lean = 0.3
    for x0, x1 in itertools.pairwise(edges):
        with kit.placed((0, 0, 0.30), turn_x(-0.06)):
            kit.box(cover, (x0 + 0.002, -hd + 0.02, 0), (x1 - 0.002, hd - 0.16, 0.13), bevel=0.035, puff=0.015)
        with kit.placed((0, hd - 0.24, seat - 0.05), turn_x(-lean)):
            top = (h - seat + 0.03) / np.cos(lean)
            kit.box(cover, (x0 + 0.002, -0.09, 0), (x1 - 0.002, 0.03, top), bevel=0.035, puff=0.015)
    with kit.placed((0, hd - 0.24, seat - 0.05), turn_x(-lean)):
        for x in np.linspace(-half + 0.05, half - 0.05, 4 * seats + 1):
            kit.box(frame, (x - 0.02, 0.03, -0.08), (x + 0.02, 0.045, (h - seat) / np.cos(lean)))
