"""Beds and throw pillows."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, turn_x, with_halves


def bed(kit: Kit, rng: np.random.Generator, size: Size, pillows: int = 2) -> None:
    """A bed: frame, mattress, a blanket that hangs over its sides, pillows, a headboard at the back."""
    w, d, h, hw, hd = with_halves(size)
    frame = paints.wood_or_board(rng, 0.7)
    padded = rng.random() < 0.35
    if padded:
        frame = paints.upholstery(rng)
    sheet = paints.plain(np.clip(rng.uniform(0.78, 0.95) + rng.normal(0, 0.02, 3), 0, 1), 0.0)
    blanket = paints.fabric(rng, 0.45)
    top = float(np.clip(rng.uniform(0.45, 0.58), 0.4, h - 0.2))
    rail = float(rng.uniform(0.26, 0.34))
    leg = float(rng.choice([0.0, 0.1, 0.16]))
    head = 0.08 if padded else 0.05
    end = hd - head
    style = int(rng.integers(3))
    kit.box(frame, (-hw, -hd, leg), (hw, end, rail), bevel=0.02 if padded else 0.006)
    if leg > 0:
        legs = paints.wood(rng) if rng.random() < 0.6 else paints.metal(rng)
        kit.legs(legs, w - 0.06, d - 0.06, leg + 0.01, 0.06, 0)
    if padded or style == 0:
        kit.box(frame, (-hw, end, 0), (hw, hd, h), bevel=0.03 if padded else 0.008, puff=0.01 if padded else 0)
    else:
        rod = frame if style == 1 else paints.metal(rng)
        for x in (-hw + 0.03, hw - 0.03):
            kit.box(rod, (x - 0.03, end, 0), (x + 0.03, hd, h), bevel=0.008)
        for z in (h - 0.1, top):
            kit.box(rod, (-hw + 0.03, end + 0.01, z), (hw - 0.03, hd - 0.01, z + 0.06), bevel=0.006)
        for x in np.linspace(-hw + 0.12, hw - 0.12, max(5, round(w / 0.14))):
            kit.tube(rod, [(x, hd - head / 2, top), (x, hd - head / 2, h - 0.08)], 0.014, sides=7)
    inset = 0.03
    kit.box(sheet, (-hw + inset, -hd + 0.04, rail - 0.05), (hw - inset, end, top), bevel=0.06, puff=0.01)
    cover_to = end - float(rng.uniform(0.5, 0.75))
    drop = float(rng.uniform(0.1, 0.28))
    low, over = top - drop, top + 0.022
    kit.box(blanket, (-hw, -hd + 0.01, low), (hw, cover_to, over), bevel=0.055, puff=0.012)
    if rng.random() < 0.6:
        turned = (-hw + 0.004, cover_to - 0.22, low + 0.02), (hw - 0.004, cover_to + 0.02, over + 0.014)
        kit.box(sheet, *turned, bevel=0.05, puff=0.01)
    if rng.random() < 0.35:
        throw = paints.fabric(rng, 0.5)
        a = -hd + float(rng.uniform(0.1, 0.3))
        kit.box(throw, (-hw - 0.004, a, low - 0.03), (hw + 0.004, a + 0.45, over + 0.01), bevel=0.05)
    case = sheet if rng.random() < 0.5 else paints.darker(blanket, 1.05)
    wide = min(0.72, (w - 2 * inset) / pillows - 0.04)
    for i in range(pillows):
        x = (i - (pillows - 1) / 2) * (w - 2 * inset) / pillows
        with kit.placed((x, end - 0.26, top - 0.02), turn_x(float(rng.uniform(0.12, 0.4)))):
            kit.pillow(case, (wide, 0.42, 0.16), cells=10, sag=0.03, sharp=0.45)


def single_bed(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bed for one."""
    bed(kit, rng, size, pillows=1)


def cushion(kit: Kit, rng: np.random.Generator, size: Size, lean_rad: float = 0.0) -> None:
    """A throw pillow with piped edges, lying flat, or leaning back by an angle from lying."""
    del size
    w = float(rng.uniform(0.36, 0.52))
    d = w if rng.random() < 0.65 else float(rng.uniform(0.28, 0.38))
    thick = float(rng.uniform(0.11, 0.17))
    cover = paints.fabric(rng, 0.6)
    piping = None
    if rng.random() < 0.7:
        piping = paints.darker(cover, 0.75) if rng.random() < 0.5 else paints.plain(rng.uniform(0.15, 0.9, 3), 0.0)
        if piping.texture is not None:
            piping = paints.plain(piping.texture.reshape(-1, 3).mean(axis=0) / 255.0, 0.0)
    sag, sharp = float(rng.uniform(0.02, 0.08)), float(rng.uniform(0.34, 0.5))
    with kit.placed((0, 0, 0), turn_x(lean_rad)):
        kit.pillow(cover, (w, d, thick), cells=14, piping=piping, sag=sag, sharp=sharp)


def leaning_cushion(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A throw pillow that leans against something behind it."""
    cushion(kit, rng, size, float(rng.uniform(1.0, 1.2)))
