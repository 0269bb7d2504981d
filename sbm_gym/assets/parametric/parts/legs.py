"""Legs that chairs, tables, cabinets and beds share."""

from sbm_gym.assets.parametric.parts.shapes import CORNERS, Kit


def four_legs(kit: Kit, paint, w: float, d: float, top: float, thick: float, style: int, inset: float = 0.0) -> None:
    """Legs at the corners of a w x d rectangle: straight, tapered or splayed rods, or square posts."""
    for sx, sy in CORNERS:
        x, y = sx * (w / 2 - thick / 2 - inset), sy * (d / 2 - thick / 2 - inset)
        if style == 0:
            kit.box(paint, (x - thick / 2, y - thick / 2, 0), (x + thick / 2, y + thick / 2, top))
        elif style == 1:
            kit.lathe(paint, [0, 0.32 * thick, 0.5 * thick, 0], [0, 0, top, top], (x, y), sides=10)
        else:
            foot = (sx * (w / 2 - 0.3 * thick), sy * (d / 2 - 0.3 * thick), 0.0)
            kit.tube(paint, [foot, (0.72 * x, 0.72 * y, top)], [0.32 * thick, 0.5 * thick], sides=9)
