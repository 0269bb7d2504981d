"""Chairs and beanbags."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import (
    CORNERS,
    Kit,
    Size,
    circle,
    grid_triangles,
    turn_x,
    turn_z,
    with_halves,
)


def dining_chair(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A chair for a table: wooden with slats or a panel, a plastic shell, or a padded one on metal."""
    w, d, h, hw, hd = with_halves(size)
    seat = float(np.clip(0.45 + rng.uniform(-0.02, 0.03), 0.4, 0.55 * h + 0.03))
    kind = int(rng.integers(4))
    frame = paints.wood_or_board(rng, 0.75) if kind < 2 else paints.metal(rng)
    cover = paints.fabric(rng, 0.4) if rng.random() < 0.7 else paints.leather(rng)
    if kind == 2:
        _shell_chair(kit, rng, size, seat, frame)
        return
    post = float(rng.uniform(0.03, 0.042))
    lean = float(rng.uniform(0.0, 0.10)) * (h - seat)
    kit.legs(frame, w, d, seat - 0.02, post, 0 if kind != 1 else int(rng.integers(3)))
    padded = kind == 3 or rng.random() < 0.4
    kit.box(frame, (-hw, -hd, seat - 0.05), (hw, hd, seat - 0.012), bevel=0.008)
    pad, bevel, puff = (cover, 0.018, 0.008) if padded else (frame, 0.006, 0.0)
    top = seat + 0.03 * padded + 0.004
    kit.box(pad, (-hw + 0.005, -hd, seat - 0.015), (hw - 0.005, hd - post, top), bevel, puff)
    back = hd - post / 2
    for x in (-hw + post / 2, hw - post / 2):
        path = [(x, back - lean, seat - 0.04), (x, back - 0.3 * lean, 0.5 * (seat + h)), (x, back, h)]
        kit.tube(frame, path, 0.5 * post, sides=6)
    style = int(rng.integers(4))
    low = seat + float(rng.uniform(0.1, 0.2))

    def at(z: float) -> float:
        return back - lean * (1 - (z - seat) / (h - seat)) ** 1.2

    if kind == 3 or style == 0:
        pad, thick, bevel, puff = (cover, 0.03, 0.014, 0.008) if kind == 3 else (frame, 0.012, 0.004, 0.0)
        half = 0.5 * (h - low)
        with kit.placed((0, 0.5 * (at(low) + at(h)), 0.5 * (low + h)), turn_x(-np.arctan2(lean, h - seat) * 0.8)):
            kit.box(pad, (-hw + 0.01, -thick, -half), (hw - 0.01, thick * 0.6, half), bevel, puff)
    elif style == 1:  # ladder back
        for z in np.linspace(low, h - 0.05, int(rng.integers(2, 5))):
            kit.box(frame, (-hw + 0.01, at(z) - 0.01, z - 0.022), (hw - 0.01, at(z) + 0.006, z + 0.03), bevel=0.004)
    else:  # upright slats between two rails
        for z in (low, h - 0.035):
            kit.box(frame, (-hw, at(z) - 0.012, z - 0.02), (hw, at(z) + 0.01, z + 0.03), bevel=0.004)
        for x in np.linspace(-hw + 0.07, hw - 0.07, int(rng.integers(3, 7))):
            kit.tube(frame, [(x, at(low), low), (x, at(h), h - 0.03)], 0.009 if style == 2 else 0.014, sides=6)
    if rng.random() < 0.4 and kind != 3:
        z = seat * 0.4
        for x in (-hw + post / 2, hw - post / 2):
            kit.box(frame, (x - 0.01, -hd + post, z), (x + 0.01, hd - post, z + 0.025))


def _shell_chair(kit: Kit, rng: np.random.Generator, size: Size, seat: float, frame) -> None:
    """A seat and back in one bent shell, on splayed legs, wires or a pedestal."""
    w, d, h = size
    shell = paints.board(rng) if rng.random() < 0.7 else paints.fabric(rng, 0.0)
    t = np.linspace(0, 1, 15)
    bend = np.clip((t - 0.42) / 0.22, 0, 1)
    bend = bend * bend * (3 - 2 * bend)
    y = -d / 2 + d * np.minimum(1.0, 1.7 * t) * (0.86 + 0.14 * t)
    z = seat - 0.03 * np.sin(np.pi * np.clip(t / 0.5, 0, 1)) + (h - seat) * np.clip((t - 0.42) / 0.58, 0, 1) ** 1.15
    u = np.linspace(-1, 1, 11)
    half = 0.5 * w * (1 - 0.25 * np.clip((t - 0.6) / 0.4, 0, 1) ** 2 - 0.1 * (1 - np.clip(t / 0.15, 0, 1)))
    rise = 0.05 * np.abs(u[:, None]) ** 3 * (0.3 + bend[None] * 0.2)
    pull = 0.09 * np.abs(u[:, None]) ** 2.5 * bend[None]
    front = np.stack([u[:, None] * half[None], y - pull, z + rise], axis=-1)
    slope_y, slope_z = np.gradient(y), np.gradient(z)
    norm = np.hypot(slope_y, slope_z)
    behind = front + 0.012 * np.stack([0 * y, slope_z / norm, -slope_y / norm], axis=-1)[None]
    rim = np.stack([np.concatenate([s[0], s[1:, -1], s[-1, -2::-1], s[-2::-1, 0]]) for s in (front, behind)])
    skins = [grid_triangles(front), grid_triangles(behind.swapaxes(0, 1)), grid_triangles(rim)]
    kit.add(shell, np.concatenate(skins), crease_rad=np.deg2rad(60))
    if rng.random() < 0.25:
        radii = [0, 0.22, 0.21, 0.04, 0.025, 0.025, 0.09, 0]
        kit.lathe(frame, radii, [0, 0, 0.015, 0.03, 0.06, seat - 0.09, seat - 0.07, seat - 0.065])
    else:
        legs = paints.wood(rng) if rng.random() < 0.6 else frame
        for sx, sy in CORNERS:
            ends = [(sx * 0.46 * w, sy * 0.46 * d, 0), (sx * 0.25 * w, sy * 0.2 * d, seat - 0.045)]
            kit.tube(legs, ends, [0.011, 0.016], sides=8)


def office_chair(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A swivel chair on a star of five castors."""
    w, d, h, _, hd = with_halves(size)
    cover = paints.fabric(rng, 0.0) if rng.random() < 0.6 else paints.leather(rng)
    black = paints.plain((0.06, 0.06, 0.065), 0.3)
    star = black if rng.random() < 0.6 else paints.plain((0.7, 0.71, 0.73), 0.8, 0.7)
    seat = float(rng.uniform(0.44, 0.52))
    reach = 0.5 * min(w, d) - 0.03
    for i in range(5):
        angle = np.pi / 2 + 2 * np.pi * i / 5
        x, y = reach * np.cos(angle), reach * np.sin(angle)
        kit.tube(star, [(0, 0, 0.12), (x, y, 0.07)], [0.028, 0.016], sides=7)
        with kit.placed((x, y, 0.03), turn_z(angle)):
            kit.prism(black, circle((0.0, 0.0), (0.028, 0.03), 10), 1, -0.02, 0.02)
    heights = [0.08, 0.28, 0.28, seat - 0.07, seat - 0.06, seat - 0.06]
    kit.lathe(black, [0.032, 0.032, 0.02, 0.02, 0.1, 0], heights, sides=10)
    wide, front = 0.82 * w, -hd + 0.03
    kit.box(cover, (-wide / 2, front, seat - 0.06), (wide / 2, front + 0.78 * d, seat + 0.03), bevel=0.035, puff=0.012)
    low = seat + float(rng.uniform(0.1, 0.2))
    back_w = wide * float(rng.uniform(0.75, 1.0))
    y = hd - 0.07
    kit.tube(black, [(0, 0.05, seat - 0.06), (0, y + 0.02, seat - 0.02), (0, y + 0.045, low + 0.15)], 0.02, sides=6)
    with kit.placed((0, y, low), turn_x(-0.08)):
        kit.box(cover, (-back_w / 2, -0.04, 0), (back_w / 2, 0.035, h - low), bevel=0.03, puff=0.012)
    if rng.random() < 0.6:
        for sx in (-1, 1):
            x = sx * (w / 2 - 0.03)
            post = [(sx * wide * 0.4, 0.02, seat - 0.05), (x, 0.02, seat - 0.03), (x, 0.02, seat + 0.2)]
            kit.tube(black, post, 0.014, sides=6)
            kit.box(black, (x - 0.03, -0.13, seat + 0.2), (x + 0.03, 0.12, seat + 0.235), bevel=0.012)


def beanbag(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A sack of beads that somebody has sat in: panels that bulge between their seams, a dent, a gathered top."""
    w, d, h = size
    cover = paints.fabric(rng, 0.2) if rng.random() < 0.75 else paints.leather(rng)
    panels = int(rng.integers(5, 8))
    phase = rng.uniform(0, 2 * np.pi)
    tall = rng.random() < 0.5
    angle = np.linspace(0, 2 * np.pi, panels * 6 + 1)
    t = np.linspace(0, 1, 15)
    # From the flat bottom out to the belly and up to the gathered top.
    at = [0, 0.12, 0.3, 0.5, 0.7, 0.88, 1]
    r = np.interp(t, at, [0, 0.86, 1.0, 0.88, *((0.56, 0.26) if tall else (0.7, 0.36)), 0.05])
    z = np.interp(t, at, [0, 0.0, 0.2, 0.46, 0.74, 0.92, 1.0])
    r, z = (np.convolve(np.pad(profile, 1, "edge"), [0.2, 0.6, 0.2], "valid") for profile in (r, z))
    r[0] = 0.0
    z -= z[0]
    seam = np.abs(np.sin(0.5 * panels * angle)) ** 0.7
    bulge = 1 - 0.07 * (1 - seam[:, None]) * np.sin(np.pi * t)[None]
    wobble = 1 + 0.05 * np.sin(2 * angle + phase)[:, None] * t + 0.03 * np.sin(3 * angle + 2 * phase)[:, None]
    radius = r[None] * bulge * wobble
    x, y = radius * np.cos(angle)[:, None], radius * np.sin(angle)[:, None]
    dent = 0.42 * np.exp(-(((x) / 0.55) ** 2 + ((y + 0.35) / 0.5) ** 2)) * (z[None] > 0.45) * (z[None] - 0.4)
    # The top leans back, behind whoever sits.
    y = y + 0.28 * z[None] ** 2
    points = np.stack([0.5 * w * x, 0.5 * d * y, h * (z[None] - dent)], axis=-1)
    points[-1] = points[0]
    kit.add(cover, grid_triangles(points), crease_rad=np.deg2rad(70))
    if rng.random() < 0.5:
        tip = points[:, -1].mean(axis=0)
        path = tip + np.array([[0, -0.02, -0.02], [0, 0.01, 0.02], [0, 0.05, 0.0]])
        kit.tube(paints.darker(cover, 0.8), path, 0.015, sides=6)
