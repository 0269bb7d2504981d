"""Colours of a labelled cloud and its boxes: by object, class, confidence, consistency, or as recorded."""

from collections.abc import Collection, Mapping
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, UInt8

from labeling.formats.ply import hues
from labeling.inspection.scene import LabelledScene

ColourBy = Literal["object", "class", "confidence", "consistency", "true colour"]
COLOURINGS: tuple[str, ...] = get_args(ColourBy)
TINT = 0.6
"""Share of an object's hue in the colour of its points, as ``write_ply`` has it by default."""
Rgb = tuple[float, float, float]
UNKNOWN: Rgb = (0.5, 0.5, 0.5)


def object_colours(scene: LabelledScene, by: str) -> dict[int, Rgb]:
    """By number the colour of each object in [0, 1]: its own, its class', or from red (0) over yellow to green (1).

    Where the consistency is unknown, it is grey.

    Args:
        scene: whose objects.
        by: one of ``COLOURINGS``; for true colour as for ``object``, since boxes have none.
    """
    classes = sorted({one.category for one in scene.objects})
    found: dict[int, Rgb] = {}
    for one in scene.objects:
        if by == "class":
            red, green, blue = hues(np.array([classes.index(one.category) + 1]))[0].tolist()
        elif by in ("confidence", "consistency"):
            red, green, blue = _traffic_light(one.confidence if by == "confidence" else one.consistency)
        else:
            red, green, blue = one.colour
        found[one.number] = (red, green, blue)
    return found


def _traffic_light(value: float | None) -> Rgb:
    return UNKNOWN if value is None else (min(1.0, 2 - 2 * value), min(1.0, 2 * value), 0.0)


def true_colours(scene: LabelledScene) -> Float[np.ndarray, "n 3"]:
    """Colours as recorded, in [0, 1], from those of the cloud, whose objects are tinted; to about two in 255."""
    seen, labelled = scene.colours / 255.0, scene.labels > 0
    whole = np.clip((seen - TINT * hues(scene.labels)) / (1 - TINT), 0.0, 1.0)
    return np.where(labelled[:, None], whole, seen)


def point_colours(
    scene: LabelledScene, by: str, shown: Collection[int], colours: Mapping[int, Rgb]
) -> UInt8[np.ndarray, "n 3"]:
    """The colour of every point: of objects that are shown tinted, of all others as recorded.

    Args:
        scene: whose cloud.
        by: one of ``COLOURINGS``; with true colour nothing is tinted.
        shown: numbers of the objects that are shown.
        colours: of objects, as ``object_colours`` gives them.
    """
    found = true_colours(scene)
    for number in shown if by != "true colour" else ():
        mine = scene.labels == number
        found[mine] = (1 - TINT) * found[mine] + TINT * np.array(colours[number])
    return np.rint(255 * found).astype(np.uint8)
