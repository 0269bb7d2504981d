"""Charts of a report as SVG: lines, bars, in the colours of the page's style sheet."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from labeling.evaluation.report.pictures import template

if TYPE_CHECKING:
    from markupsafe import Markup

WIDTH, HEIGHT, LEFT, BOTTOM = 320, 210, 46, 34
"""Of a chart and of its margins, in its own units; it is as wide as the page lets it."""
TOP = RIGHT = 8


def line_chart(
    lines: Sequence[tuple[str, str, Sequence[float]]], across: str, up: str, diagonal: bool = False
) -> "Markup":
    """Curves over [0, 1].

    Args:
        lines: for each its style (a class of the style sheet), the category it is of ("" for all), and its heights in
            [0, 1] at even steps from 0 to 1.
        across: what the axis below shows.
        up: what the axis at the left shows.
        diagonal: draw the line where both are equal.
    """
    drawn = []
    for style, category, values in lines:
        places = [(_x(index / max(1, len(values) - 1)), _y(value)) for index, value in enumerate(values)]
        path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in places) if places else ""
        drawn.append({"style": style, "category": category, "path": path})
    return _chart(lines=drawn, bars=[], dots=[], across=across, up=up, diagonal=diagonal, most=1.0)


def histogram(bars: Mapping[str, Sequence[float]], across: str, up: str, least: float = 0) -> "Markup":
    """Bars over even parts of [0, 1], those of several methods side by side.

    Args:
        bars: by style their heights, 0 or more.
        across: what the axis below shows.
        up: what the axis at the left shows.
        least: where the axis ends at least, for bars that will grow.
    """
    # A multiple of four, so that the ticks are whole numbers.
    most = 4 * math.ceil(max([least, *(value for values in bars.values() for value in values)]) / 4) or 4
    drawn = []
    for place, (style, values) in enumerate(bars.items()):
        step = (WIDTH - LEFT - RIGHT) / max(1, len(values))
        wide = 0.8 * step / len(bars)
        for index, value in enumerate(values):
            x = LEFT + step * (index + 0.1) + wide * place
            top = _y(value / most)
            drawn.append({"style": style, "x": x, "y": top, "width": wide, "height": _y(0) - top, "value": value})
    return _chart(lines=[], bars=drawn, dots=[], across=across, up=up, diagonal=False, most=most)


def reliability_chart(methods: Mapping[str, Sequence[tuple[int, float | None]]], across: str, up: str) -> "Markup":
    """Mean IoU of even parts of confidence as dots, larger where there are more, beside the line where both are equal.

    Args:
        methods: by style, for each part of confidence how many there are and their mean.
        across: what the axis below shows.
        up: what the axis at the left shows.
    """
    dots, lines = [], []
    for style, parts in methods.items():
        most = max((count for count, _ in parts), default=0) or 1
        places = [
            (_x((index + 0.5) / len(parts)), _y(mean), count)
            for index, (count, mean) in enumerate(parts)
            if mean is not None
        ]
        dots += [{"style": style, "x": x, "y": y, "r": 2 + 5 * (n / most) ** 0.5, "count": n} for x, y, n in places]
        if places:
            path = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y, _ in places)
            lines.append({"style": style, "category": "", "path": path})
    return _chart(lines=lines, bars=[], dots=dots, across=across, up=up, diagonal=True, most=1.0)


def _x(share: float) -> float:
    return LEFT + share * (WIDTH - LEFT - RIGHT)


def _y(share: float) -> float:
    return HEIGHT - BOTTOM - share * (HEIGHT - BOTTOM - TOP)


def _chart(most: float, **drawn: object) -> "Markup":
    from markupsafe import Markup

    fives = [0.0, 0.25, 0.5, 0.75, 1.0]
    ticks = {
        "across": [(f"{share:g}", _x(share)) for share in fives],
        "up": [(f"{share * most:.3g}", _y(share)) for share in fives],
    }
    size = {"width": WIDTH, "height": HEIGHT, "left": LEFT, "right": WIDTH - RIGHT, "floor": _y(0), "top": TOP}
    return Markup(template("chart.svg.jinja").render(ticks=ticks, most=most, **size, **drawn))
