"""Tables, desks, cabinets, shelves and beds."""

import itertools

import numpy as np

from sbm_gym.assets.builtin_models import paints
from sbm_gym.assets.builtin_models.seating import Size, four_legs
from sbm_gym.assets.builtin_models.shapes import Kit, turn_x


def _oval(w: float, d: float, sides: int = 28) -> list[tuple[float, float]]:
    angle = np.arange(sides) * 2 * np.pi / sides
    return [(0.5 * w * float(np.cos(a)), 0.5 * d * float(np.sin(a))) for a in angle]


def dining_table(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A table: rectangular or round, on legs, a pedestal or two frames."""
    w, d, h = size
    top = paints.wood_or_board(rng, 0.7)
    legs = top if rng.random() < 0.5 else (paints.metal(rng) if rng.random() < 0.5 else paints.board(rng))
    thick = float(rng.uniform(0.02, 0.045))
    round_top = abs(w - d) < 0.02 and rng.random() < 0.75
    if round_top:
        kit.prism(top, _oval(w, d), 2, h - thick, h)
    else:
        kit.box(top, (-w / 2, -d / 2, h - thick), (w / 2, d / 2, h), bevel=0.006)
    kind = int(rng.integers(4))
    if round_top and kind < 3:
        r = 0.28 * w
        kit.lathe(
            legs,
            [(0, 0), (r, 0), (r, 0.02), (0.06, 0.06), (0.04, 0.12), (0.035, h - 0.2), (0.1, h - thick), (0, h - thick)],
            sides=18,
        )
    elif kind == 3 and not round_top:
        for sx in (-1, 1):
            x = sx * (0.5 * w - 0.12)
            kit.box(legs, (x - 0.04, -0.42 * d, 0), (x + 0.04, 0.42 * d, 0.04), bevel=0.006)
            kit.box(legs, (x - 0.03, -0.06, 0.04), (x + 0.03, 0.06, h - 0.05), bevel=0.006)
            kit.box(legs, (x - 0.04, -0.4 * d, h - 0.08), (x + 0.04, 0.4 * d, h - thick), bevel=0.006)
        kit.box(legs, (-0.5 * w + 0.12, -0.03, 0.3), (0.5 * w - 0.12, 0.03, 0.4))
    else:
        reach = 0.72 if round_top else 1.0
        post = float(rng.uniform(0.04, 0.09))
        four_legs(kit, legs, reach * w, reach * d, h - thick, post, int(rng.integers(3)), inset=0.01)
        if kind != 1 and not round_top:
            for sy in (-1, 1):
                kit.box(
                    legs,
                    (-w / 2 + post, sy * (d / 2 - post / 2 - 0.02) - 0.01, h - thick - 0.09),
                    (w / 2 - post, sy * (d / 2 - post / 2 - 0.02) + 0.01, h - thick),
                )
            for sx in (-1, 1):
                kit.box(
                    legs,
                    (sx * (w / 2 - post / 2 - 0.02) - 0.01, -d / 2 + post, h - thick - 0.09),
                    (sx * (w / 2 - post / 2 - 0.02) + 0.01, d / 2 - post, h - thick),
                )


def coffee_table(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A low table, often with a board below."""
    w, d, h = size
    top = paints.wood_or_board(rng, 0.65)
    legs = top if rng.random() < 0.5 else paints.metal(rng)
    thick = float(rng.uniform(0.02, 0.05))
    if abs(w - d) < 0.02:
        kit.prism(top, _oval(w, d), 2, h - thick, h)
        if rng.random() < 0.3:
            kit.lathe(top, [(0, 0), (0.35 * w, 0), (0.35 * w, h - thick), (0, h - thick)], sides=20)
        else:
            four_legs(kit, legs, 0.75 * w, 0.75 * d, h - thick, 0.04, int(rng.integers(1, 3)))
        return
    kit.box(top, (-w / 2, -d / 2, h - thick), (w / 2, d / 2, h), bevel=0.006)
    if rng.random() < 0.25:
        for sx in (-1, 1):
            kit.box(
                top,
                (sx * (w / 2 - 0.04) - 0.025, -d / 2 + 0.02, 0),
                (sx * (w / 2 - 0.04) + 0.025, d / 2 - 0.02, h - thick),
            )
    else:
        four_legs(kit, legs, w, d, h - thick, float(rng.uniform(0.035, 0.07)), int(rng.integers(3)), inset=0.015)
    if rng.random() < 0.6:
        kit.box(top, (-w / 2 + 0.06, -d / 2 + 0.06, 0.12), (w / 2 - 0.06, d / 2 - 0.06, 0.14))


def desk(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A desk: a top on legs or trestles, with or without a chest of drawers at one side; one sits before its front."""
    w, d, h = size
    top = paints.wood_or_board(rng, 0.55)
    body = top if rng.random() < 0.6 else paints.board(rng)
    legs = paints.metal(rng) if rng.random() < 0.5 else body
    kit.box(top, (-w / 2, -d / 2, h - 0.028), (w / 2, d / 2, h), bevel=0.004)
    kind = int(rng.integers(3))
    if kind == 0:
        four_legs(kit, legs, w, d, h - 0.028, 0.05, int(rng.integers(2)), inset=0.02)
        kit.box(body, (-w / 2 + 0.07, d / 2 - 0.05, h - 0.3), (w / 2 - 0.07, d / 2 - 0.03, h - 0.028))
        return
    sides = (-1, 1) if kind == 2 and w > 1.3 else (int(rng.choice([-1, 1])),)
    for sx in (-1, 1):
        if sx in sides:
            x0, x1 = sorted((sx * (w / 2 - 0.02), sx * (w / 2 - 0.02 - min(0.4, 0.32 * w))))
            kit.box(body, (x0, -d / 2 + 0.035, 0), (x1, d / 2 - 0.02, h - 0.028))
            drawers(kit, rng, body, (x0, x1), (0.05, h - 0.04), -d / 2 + 0.035, 1, int(rng.integers(2, 5)))
        else:
            x = sx * (w / 2 - 0.035)
            kit.box(body, (x - 0.014, -d / 2 + 0.03, 0), (x + 0.014, d / 2 - 0.02, h - 0.028))
    kit.box(body, (-w / 2 + 0.05, d / 2 - 0.06, 0.3), (w / 2 - 0.05, d / 2 - 0.04, h - 0.028))


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
                kit.lathe(
                    grip,
                    [(0, mz - 0.013), (0.013, mz - 0.008), (0.013, mz + 0.008), (0, mz + 0.013)],
                    (mx, y - 0.012),
                    sides=8,
                )
            elif doors:
                kit.box(grip, (mx - 0.006, y - 0.024, mz - 0.07), (mx + 0.006, y - 0.01, mz + 0.07))
                for z in (mz - 0.06, mz + 0.06):
                    kit.box(grip, (mx - 0.005, y - 0.012, z - 0.005), (mx + 0.005, y, z + 0.005))
            else:
                half = min(0.06, 0.25 * (b - a))
                kit.box(grip, (mx - half, y - 0.024, mz - 0.006), (mx + half, y - 0.01, mz + 0.006))
                for x in (mx - half + 0.01, mx + half - 0.01):
                    kit.box(grip, (x - 0.005, y - 0.012, mz - 0.005), (x + 0.005, y, mz + 0.005))


def _carcass(kit: Kit, rng, paint, size: Size, foot: float) -> float:
    """The body of a cabinet on a plinth or legs; returns the y of its front."""
    w, d, h = size
    front = -d / 2 + 0.045
    if foot > 0.06:
        legs = paints.wood(rng) if rng.random() < 0.5 else paints.metal(rng)
        with kit.placed((0, 0.02, 0)):
            four_legs(kit, legs, w - 0.04, d - 0.06, foot + 0.005, 0.035, int(rng.integers(2)))
    else:
        kit.box(paints.darker(paint, 0.5), (-w / 2 + 0.02, front + 0.03, 0), (w / 2 - 0.02, d / 2, foot))
    kit.box(paint, (-w / 2 + 0.005, front, foot), (w / 2 - 0.005, d / 2, h - 0.022))
    top = paint if rng.random() < 0.7 else paints.wood(rng)
    kit.box(top, (-w / 2, -d / 2, h - 0.024), (w / 2, d / 2, h), bevel=0.004)
    return front


def nightstand(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A small cabinet beside a bed: drawers, or a drawer over an open shelf."""
    w, d, h = size
    paint = paints.wood_or_board(rng, 0.7)
    foot = float(rng.choice([0.03, 0.1, 0.16]))
    if rng.random() < 0.4:
        post = 0.035
        four_legs(kit, paint, w, d, h - 0.02, post, 0)
        kit.box(paint, (-w / 2, -d / 2, h - 0.024), (w / 2, d / 2, h), bevel=0.004)
        kit.box(paint, (-w / 2 + 0.01, -d / 2 + 0.03, h - 0.2), (w / 2 - 0.01, d / 2 - 0.005, h - 0.024))
        drawers(kit, rng, paint, (-w / 2 + 0.03, w / 2 - 0.03), (h - 0.19, h - 0.03), -d / 2 + 0.03, 1, 1)
        kit.box(paint, (-w / 2 + 0.01, -d / 2 + 0.02, 0.12), (w / 2 - 0.01, d / 2 - 0.01, 0.14))
        if rng.random() < 0.5:
            book_row(kit, rng, -w / 2 + 0.06, w / 2 - 0.08, -0.1, 0.08, 0.14, 0.1)
        return
    front = _carcass(kit, rng, paint, size, foot)
    drawers(
        kit, rng, paint, (-w / 2 + 0.01, w / 2 - 0.01), (foot + 0.005, h - 0.028), front, 1, int(rng.integers(1, 4))
    )


def dresser(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A chest of drawers."""
    w, _, h = size
    paint = paints.wood_or_board(rng, 0.7)
    foot = float(rng.choice([0.04, 0.12]))
    front = _carcass(kit, rng, paint, size, foot)
    drawers(
        kit,
        rng,
        paint,
        (-w / 2 + 0.01, w / 2 - 0.01),
        (foot + 0.005, h - 0.028),
        front,
        1 if w < 0.85 else 2,
        int(rng.integers(3, 6)),
    )


def tv_stand(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A low, wide cabinet."""
    w, _, h = size
    paint = paints.wood_or_board(rng, 0.6)
    foot = float(rng.choice([0.03, 0.1]))
    front = _carcass(kit, rng, paint, size, foot)
    columns = int(rng.integers(2, 4))
    drawers(
        kit,
        rng,
        paint,
        (-w / 2 + 0.01, w / 2 - 0.01),
        (foot + 0.005, h - 0.028),
        front,
        columns,
        int(rng.integers(1, 3)),
        doors=rng.random() < 0.4,
    )


def cupboard(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A wardrobe with two to four doors."""
    w, _, h = size
    paint = paints.wood_or_board(rng, 0.55)
    front = _carcass(kit, rng, paint, size, 0.05)
    low = 0.055
    if rng.random() < 0.35:
        low = 0.3
        drawers(kit, rng, paint, (-w / 2 + 0.01, w / 2 - 0.01), (0.055, low), front, 2, 1)
    drawers(
        kit, rng, paint, (-w / 2 + 0.01, w / 2 - 0.01), (low, h - 0.028), front, max(2, round(w / 0.5)), 1, doors=True
    )


def office_cabinet(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A filing cabinet."""
    w, d, h = size
    paint = paints.plain(tuple([float(rng.choice([0.25, 0.6, 0.8]))] * 3), 0.3)
    kit.box(paint, (-w / 2, -d / 2 + 0.04, 0), (w / 2, d / 2, h))
    drawers(kit, rng, paint, (-w / 2 + 0.005, w / 2 - 0.005), (0.03, h - 0.01), -d / 2 + 0.04, 1, 4 if h > 1.1 else 3)


def kitchen_unit(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A base cabinet with a worktop: doors, drawers, a sink or a hob."""
    w, d, h = size
    paint = paints.board(rng) if rng.random() < 0.6 else paints.wood(rng)
    stone = (
        paints.wood(rng)
        if rng.random() < 0.5
        else paints.plain(tuple([float(rng.choice([0.15, 0.5, 0.75]))] * 3), 0.4, 0.6)
    )
    front = -d / 2 + 0.05
    kit.box(paints.plain((0.12, 0.12, 0.12)), (-w / 2 + 0.005, front + 0.05, 0), (w / 2 - 0.005, d / 2, 0.1))
    kit.box(paint, (-w / 2, front, 0.1), (w / 2, d / 2, h - 0.035))
    kit.box(stone, (-w / 2, -d / 2, h - 0.038), (w / 2, d / 2, h), bevel=0.003)
    kind = int(rng.integers(4))
    rows = int(rng.integers(2, 5)) if kind == 0 else 1
    drawers(
        kit,
        rng,
        paint,
        (-w / 2 + 0.002, w / 2 - 0.002),
        (0.105, h - 0.042),
        front,
        1 if w < 0.7 or kind == 0 else 2,
        rows,
        doors=kind != 0,
    )
    steel = paints.plain((0.7, 0.71, 0.72), 0.8, 0.7)
    if kind == 1:
        kit.box(steel, (-0.36 * w, -0.2 * d, h - 0.03), (0.36 * w, 0.24 * d, h + 0.004))
        kit.box(paints.plain((0.35, 0.36, 0.37), 0.6), (-0.31 * w, -0.15 * d, h), (0.31 * w, 0.2 * d, h + 0.0055))
        kit.tube(
            steel, [(0, 0.32 * d, h), (0, 0.32 * d, h + 0.2), (0, 0.22 * d, h + 0.26), (0, 0.1 * d, h + 0.23)], 0.012
        )
    elif kind == 2:
        kit.box(
            paints.plain((0.04, 0.04, 0.045), 0.7, 0.8),
            (-0.44 * w, -0.36 * d, h - 0.01),
            (0.44 * w, 0.36 * d, h + 0.006),
        )
        for x in (-0.22, 0.22):
            for y in (-0.18, 0.18):
                kit.lathe(
                    paints.plain((0.16, 0.15, 0.15)),
                    [(0, h + 0.0075), (0.3 * min(w, d) * 0.5, h + 0.0065)][::-1],
                    (x * w, y * d),
                )


def book_row(kit: Kit, rng, x0: float, x1: float, y0: float, y1: float, z: float, high: float) -> None:
    """Books from x0 to x1, their spines towards -Y."""
    row = paints.books(rng)
    top = z + high
    paper = paints.plain((0.85, 0.82, 0.74), 0.0)
    kit.card(row, [(x0, y0, z), (x1, y0, z), (x1, y0, top), (x0, y0, top)])
    kit.card(paper, [(x0, y0, top - 0.02), (x1, y0, top - 0.02), (x1, y1, top - 0.02), (x0, y1, top - 0.02)])
    kit.card(
        row,
        [(x1, y0, z), (x1, y1, z), (x1, y1, top - 0.02), (x1, y0, top - 0.02)],
        [[0.97, 1], [1, 1], [1, 0.2], [0.97, 0.2]],
    )
    kit.card(
        row,
        [(x0, y1, z), (x0, y0, z), (x0, y0, top - 0.02), (x0, y1, top - 0.02)],
        [[0, 1], [0.03, 1], [0.03, 0.2], [0, 0.2]],
    )


def shelf(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """Open shelves with books and boxes: a bookcase, a frame of metal, or cubes."""
    w, d, h = size
    kind = int(rng.integers(3))
    paint = paints.wood_or_board(rng, 0.6)
    thick = 0.022
    rows = max(2, round(h / float(rng.uniform(0.3, 0.42))))
    columns = 1 if w < 0.7 else int(rng.integers(1, 1 + max(2, round(w / 0.4))))
    if kind == 2:
        columns = max(1, round(w / 0.38))
        rows = max(2, round(h / 0.38))
    posts = paints.metal(rng) if kind == 1 else paint
    foot = 0.0 if kind == 2 else float(rng.choice([0.02, 0.07]))
    if kind == 1:
        for sx in (-1, 1):
            for sy in (-1, 1):
                x, y = sx * (w / 2 - 0.014), sy * (d / 2 - 0.014)
                kit.box(posts, (x - 0.014, y - 0.014, 0), (x + 0.014, y + 0.014, h))
    else:
        for x in np.linspace(-w / 2 + thick / 2, w / 2 - thick / 2, columns + 1):
            kit.box(
                paint,
                (x - thick / 2, -d / 2, 0),
                (x + thick / 2, d / 2, h - thick if 0 < abs(x) < w / 2 - thick else h),
            )
    levels = np.linspace(foot, h - thick, rows + 1)
    for z in levels:
        kit.box(paint, (-w / 2 + 0.004, -d / 2 + 0.004, z), (w / 2 - 0.004, d / 2 - 0.004, z + thick))
    if kind != 1 and rng.random() < 0.6:
        kit.box(
            paints.darker(paint, 0.85), (-w / 2 + thick, d / 2 - 0.012, foot), (w / 2 - thick, d / 2 - 0.002, h - thick)
        )
    cells = columns if kind != 1 else max(1, round(w / 0.6))
    for z, above in itertools.pairwise(levels):
        room = above - z - thick
        for i in range(cells):
            x0, x1 = -w / 2 + w * i / cells + 0.025, -w / 2 + w * (i + 1) / cells - 0.025
            what = rng.random()
            base = float(z) + thick
            if what < 0.55:
                share = float(rng.uniform(0.4, 1.0))
                a = x0 if rng.random() < 0.5 else x1 - share * (x1 - x0)
                book_row(
                    kit,
                    rng,
                    a,
                    a + share * (x1 - x0),
                    -d / 2 + 0.04,
                    d / 2 - 0.05,
                    base,
                    float(rng.uniform(0.6, 0.9)) * room,
                )
            elif what < 0.72:
                box = paints.fabric(rng, 0.2) if rng.random() < 0.5 else paints.board(rng)
                kit.box(
                    box,
                    (x0 + 0.01, -d / 2 + 0.02, base),
                    (x1 - 0.01, d / 2 - 0.04, base + float(rng.uniform(0.5, 0.85)) * room),
                    bevel=0.006,
                )
            elif what < 0.88:
                r = min(0.07, 0.3 * (x1 - x0), 0.3 * d)
                high = float(rng.uniform(0.5, 0.85)) * room
                x = float(rng.uniform(x0 + r, x1 - r))
                kit.lathe(
                    paints.board(rng),
                    [
                        (0, base),
                        (0.6 * r, base),
                        (r, base + 0.45 * high),
                        (0.45 * r, base + 0.8 * high),
                        (0.55 * r, base + high),
                        (0, base + high - 0.01),
                    ],
                    (x, 0),
                    sides=12,
                )


def bed(kit: Kit, rng: np.random.Generator, size: Size, pillows: int = 2) -> None:
    """A bed: frame, mattress, a blanket that hangs over its sides, pillows, a headboard at the back."""
    w, d, h = size
    frame = paints.wood_or_board(rng, 0.7)
    padded = rng.random() < 0.35
    if padded:
        frame = paints.upholstery(rng)
    sheet = paints.plain(tuple(float(c) for c in np.clip(rng.uniform(0.78, 0.95) + rng.normal(0, 0.02, 3), 0, 1)), 0.0)
    blanket = paints.fabric(rng, 0.45)
    top = float(np.clip(rng.uniform(0.45, 0.58), 0.4, h - 0.2))
    rail = float(rng.uniform(0.26, 0.34))
    leg = float(rng.choice([0.0, 0.1, 0.16]))
    head = 0.08 if padded else 0.05
    style = int(rng.integers(3))
    kit.box(frame, (-w / 2, -d / 2, leg), (w / 2, d / 2 - head, rail), bevel=0.02 if padded else 0.006)
    if leg > 0:
        legs = paints.wood(rng) if rng.random() < 0.6 else paints.metal(rng)
        four_legs(kit, legs, w - 0.06, d - 0.06, leg + 0.01, 0.06, 0)
    if padded or style == 0:
        kit.box(
            frame,
            (-w / 2, d / 2 - head, 0),
            (w / 2, d / 2, h),
            bevel=0.03 if padded else 0.008,
            puff=0.01 if padded else 0,
        )
    else:
        rod = frame if style == 1 else paints.metal(rng)
        for sx in (-1, 1):
            kit.box(
                rod, (sx * (w / 2 - 0.03) - 0.03, d / 2 - head, 0), (sx * (w / 2 - 0.03) + 0.03, d / 2, h), bevel=0.008
            )
        for z in (h - 0.1, top):
            kit.box(rod, (-w / 2 + 0.03, d / 2 - head + 0.01, z), (w / 2 - 0.03, d / 2 - 0.01, z + 0.06), bevel=0.006)
        for x in np.linspace(-w / 2 + 0.12, w / 2 - 0.12, max(5, round(w / 0.14))):
            kit.tube(rod, [(x, d / 2 - head / 2, top), (x, d / 2 - head / 2, h - 0.08)], 0.014, sides=7)
    inset = 0.03
    end = d / 2 - head
    kit.box(sheet, (-w / 2 + inset, -d / 2 + 0.04, rail - 0.05), (w / 2 - inset, end, top), bevel=0.06, puff=0.01)
    cover_to = end - float(rng.uniform(0.5, 0.75))
    drop = float(rng.uniform(0.1, 0.28))
    over = 0.022
    kit.box(blanket, (-w / 2, -d / 2 + 0.01, top - drop), (w / 2, cover_to, top + over), bevel=0.055, puff=0.012)
    if rng.random() < 0.6:
        kit.box(
            sheet,
            (-w / 2 + 0.004, cover_to - 0.22, top - drop + 0.02),
            (w / 2 - 0.004, cover_to + 0.02, top + over + 0.014),
            bevel=0.05,
            puff=0.01,
        )
    if rng.random() < 0.35:
        throw = paints.fabric(rng, 0.5)
        a = -d / 2 + float(rng.uniform(0.1, 0.3))
        kit.box(throw, (-w / 2 - 0.004, a, top - drop - 0.03), (w / 2 + 0.004, a + 0.45, top + over + 0.01), bevel=0.05)
    case = sheet if rng.random() < 0.5 else paints.darker(blanket, 1.05)
    wide = min(0.72, (w - 2 * inset) / pillows - 0.04)
    for i in range(pillows):
        x = (i - (pillows - 1) / 2) * (w - 2 * inset) / pillows
        with kit.placed((x, end - 0.26, top - 0.02), turn_x(float(rng.uniform(0.12, 0.4)))):
            kit.pillow(case, (wide, 0.42, 0.16), cells=10, sag=0.03, sharp=0.45)


def single_bed(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A bed for one."""
    bed(kit, rng, size, pillows=1)
