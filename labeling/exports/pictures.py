"""Pictures of exports: PNG files of colour, and of the instance and the class of every pixel."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8, UInt16

from labeling.core.errors import UsageError
from labeling.io.labelled_views import LabelledView

Picture = UInt8[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"]
"""Colour (RGB), or one number a pixel of 8 or 16 bits."""


def write_png(path: Path, picture: Picture) -> None:
    """Writes a picture.

    Raises:
        OSError: if it cannot be written.
    """
    encoded, png = cv2.imencode(".png", picture[..., ::-1] if picture.ndim == 3 else picture)
    assert encoded
    path.write_bytes(png.tobytes())


def instance_map(view: LabelledView) -> UInt16[np.ndarray, "h w"]:
    """The instance id of every pixel, 0 for none; where masks overlap, that of the more confident one.

    Raises:
        UsageError: if an instance id is below 1 or above 65535.
    """
    instances = np.zeros(view.rgb.shape[:2], np.uint16)
    for label in view.labels:
        if not 0 < label.instance_id <= np.iinfo(np.uint16).max:
            raise UsageError(f"a PNG has room for instance ids from 1 to 65535, not {label.instance_id}")
        instances[label.mask] = label.instance_id
    return instances


def write_masks(out: Path, views: Iterable[LabelledView], categories: Sequence[str]) -> int:
    """Writes ``images``, ``instances``, ``classes``: one PNG a view each; and ``masks.json``. Returns how many labels.

    A pixel of ``instances`` (16 bits) is an instance id of the label set, of ``classes`` (8 bits) one more than the
    index of a category in ``masks.json``; 0 is none. Where masks overlap the more confident one is seen.

    Args:
        out: an empty folder.
        views: to write.
        categories: their names.

    Raises:
        UsageError: if there are more categories than 255, or an instance id is below 1 or above 65535.
    """
    if len(categories) > 255:
        raise UsageError(f"a PNG of classes has room for 255 categories; there are {len(categories)}")
    for kind in ("images", "instances", "classes"):
        (out / kind).mkdir()
    category_of: dict[int, str] = {}
    count = 0
    for view in views:
        instances, classes = instance_map(view), np.zeros(view.rgb.shape[:2], np.uint8)
        for label in view.labels:
            classes[label.mask] = categories.index(label.category) + 1
            category_of[label.instance_id] = label.category
        for kind, picture in (("images", view.rgb), ("instances", instances), ("classes", classes)):
            write_png(out / kind / f"{view.name}.png", picture)
        count += len(view.labels)
    content = {"categories": list(categories), "category_of_instance": category_of}
    (out / "masks.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return count
