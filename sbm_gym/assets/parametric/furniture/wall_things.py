"""What hangs on the walls of halls and offices: coats, whiteboards, clocks."""

import numpy as np

from sbm_gym.assets.parametric.parts import paints
from sbm_gym.assets.parametric.parts.shapes import Kit, Size, circle, grid_triangles, with_halves


def coat_rack(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A board with hooks, coats and bags hanging from some of them."""
    w, _, h, hw, hd = with_halves(size)
    board = paints.wood_or_board(rng, 0.7)
    hook = paints.metal(rng)
    kit.box(board, (-hw, hd - 0.02, h - 0.12), (hw, hd, h), bevel=0.004)
    places = np.linspace(-hw + 0.09, hw - 0.09, max(round(w / 0.17), 3))
    z, y = h - 0.09, hd - 0.02
    for x in places:
        kit.tube(hook, [(x, y, z), (x, y - 0.05, z - 0.01), (x, y - 0.07, z + 0.03)], 0.007, sides=6)
    hung = rng.permutation(len(places))[: max(len(places) // 2, 1)]
    for number, index in enumerate(sorted(hung.tolist())):
        x = float(np.clip(places[index], -hw + 0.17, hw - 0.17))
        cloth = paints.fabric(rng, 0.15) if rng.random() < 0.7 else paints.leather(rng)
        bottom = 0.0 if number == 0 else float(rng.uniform(0.0, 0.35)) * h
        deep = y - 0.012 * number
        # A body that widens downwards, with its sleeves beside it.
        halves, heights = np.array([0.05, 0.14, 0.15, 0.17]), [z, z - 0.1, 0.5 * (z + bottom), bottom]
        turn = np.linspace(0, 2 * np.pi, 17)
        fold = 1 + 0.1 * np.cos(5 * turn + index)
        points = np.stack(
            [
                x + halves[None] * np.cos(turn)[:, None] * fold[:, None],
                deep - 0.055 + 0.05 * np.sin(turn)[:, None] * (halves / halves.max())[None] * fold[:, None],
                np.broadcast_to(heights, (17, 4)),
            ],
            axis=-1,
        )
        points[-1] = points[0]
        kit.add(cloth, grid_triangles(points[:, ::-1]), crease_rad=np.deg2rad(70))
        for sx in (-1, 1):
            cuff = z - 0.6 * (z - bottom) - 0.05
            sleeve = [(x + sx * 0.11, deep - 0.06, z - 0.1), (x + sx * 0.155, deep - 0.06, cuff)]
            kit.tube(cloth, sleeve, [0.045, 0.038], sides=8)


def whiteboard(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A whiteboard for a wall, with what is left of a meeting."""
    w, _, h, hw, hd = with_halves(size)
    kit.box(paints.STEEL, (-hw, -hd + 0.06, 0), (hw, hd, h), bevel=0.003)
    rows, columns = 96, 160
    board = np.full((rows, columns, 3), 0.94)
    inks = ((0.1, 0.2, 0.6), (0.7, 0.1, 0.1), (0.1, 0.45, 0.2), (0.1, 0.1, 0.12))
    for _ in range(int(rng.integers(3, 9))):
        ink = inks[rng.integers(4)]
        top, left = int(rng.integers(6, rows - 30)), int(rng.integers(6, columns - 60))
        if rng.random() < 0.6:  # lines of writing
            for line in range(int(rng.integers(2, 5))):
                row, at = top + 6 * line, left
                while at < left + 50 and row < rows - 4:
                    word = int(rng.integers(3, 10))
                    board[row : row + 2, at : at + word] = ink
                    at += word + 3
        else:  # a frame, as of a diagram
            high, wide = int(rng.integers(10, 24)), int(rng.integers(16, 40))
            board[[top, top + high], left : left + wide] = ink
            board[top : top + high, [left, left + wide]] = ink
    face = paints.Paint(texture=paints.picture(board), tile_m=None, specular=0.5, shininess=0.8)
    kit.picture(face, (-hw + 0.02, hw - 0.02), (0.02, h - 0.02), -hd + 0.058)
    kit.box(paints.STEEL, (-0.3 * w, -hd, 0), (0.3 * w, -hd + 0.062, 0.016))
    for i in range(3):
        x = (-0.2 + 0.08 * i) * w
        pen = paints.plain(inks[i], 0.2)
        kit.tube(pen, [(x, -hd + 0.03, 0.024), (x + 0.11, -hd + 0.03, 0.024)], 0.008, sides=6)


def clock_size(size: Size) -> Size:
    """Clocks are as high as they are wide."""
    return size[0], size[1], size[0]


def wall_clock(kit: Kit, rng: np.random.Generator, size: Size) -> None:
    """A round clock."""
    w, d, h = size
    rim = paints.metal(rng) if rng.random() < 0.7 else paints.wood(rng)
    face = paints.plain((0.95, 0.94, 0.9) if rng.random() < 0.8 else (0.12, 0.12, 0.13), 0.2)
    ink = paints.BLACK if face.rgb[0] > 0.5 else paints.plain((0.9, 0.9, 0.88))
    middle, front = h / 2, -d / 2
    for paint, scale, y in ((rim, 1.0, front), (face, 0.9, front - 0.002)):
        kit.prism(paint, circle((middle, 0.0), (0.5 * scale * h, 0.5 * scale * w), 28), 1, y, d / 2)
    for hour in range(12):
        a = hour * np.pi / 6
        x, z = 0.38 * w * np.sin(a), middle + 0.38 * h * np.cos(a)
        kit.box(ink, (x - 0.006, front - 0.004, z - 0.006), (x + 0.006, front, z + 0.006))
    for length, wide in ((0.22, 0.010), (0.34, 0.006)):
        a = float(rng.uniform(0, 2 * np.pi))
        tip = (length * w * np.sin(a), front - 0.006, middle + length * h * np.cos(a))
        kit.tube(ink, [(0, front - 0.006, middle), tip], wide / 2, sides=5)
