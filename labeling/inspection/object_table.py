"""The objects of a scene as an HTML table."""

import html
from collections.abc import Sequence

from labeling.inspection.scene import SceneObject

CELL = "padding:2px 6px;text-align:left;vertical-align:top"


def object_table(objects: Sequence[SceneObject]) -> str:
    """The objects as an HTML table, in which what stands in files is escaped.

    Number, class, confidence, how many views show it, its consistency, and where its surest detection is.
    """
    heads = ("", "class", "sure", "views", "agree", "found in")
    rows = []
    for one in objects:
        agree = "" if one.consistency is None else f"{one.consistency:.0%}"
        cells = (one.number, one.category, f"{one.confidence:.2f}", len(one.views), agree, one.source)
        rows.append("".join(f'<td style="{CELL}">{html.escape(str(cell))}</td>' for cell in cells))
    head = "".join(f'<th style="{CELL}">{name}</th>' for name in heads)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return f'<table style="font-size:12px;border-collapse:collapse"><tr>{head}</tr>{body}</table>'
