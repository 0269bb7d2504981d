"""Label sets as Ultralytics' YOLO reads them: pictures, a text file of labels for each, and data.yaml."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.masks import box_xywh
from labeling.exports.outlines import joined_outline
from labeling.exports.pictures import write_png
from labeling.io.labelled_views import LabelledView

DIGITS = 6
"""After the point, of coordinates as shares of the picture."""


def write_yolo(out: Path, views: Iterable[LabelledView], categories: Sequence[str], segment: bool) -> int:
    """Writes ``data.yaml``, ``images/train`` and ``labels/train``; returns the number of labels.

    A line of a label file is a class (its index in data.yaml) and, as shares of width and height, centre and size of a
    box or the corners of a polygon. YOLO has no confidence, no holes and nothing to ignore: pieces of a mask are joined
    by a thin bridge, and holes are filled.

    Args:
        out: an empty folder.
        views: to write.
        categories: class names, in the order of their indices.
        segment: polygons instead of boxes.
    """
    for kind in ("images", "labels"):
        (out / kind / "train").mkdir(parents=True)
    count = 0
    for view in views:
        lines = []
        for label in view.labels:
            values = polygon_of(label.mask).ravel() if segment else box_of(label.mask)
            numbers = " ".join(f"{value:.{DIGITS}f}" for value in values)
            lines.append(f"{categories.index(label.category)} {numbers}\n")
        write_png(out / "images" / "train" / f"{view.name}.png", view.rgb)
        (out / "labels" / "train" / f"{view.name}.txt").write_text("".join(lines), encoding="utf-8")
        count += len(lines)
    # JSON strings are YAML strings, whatever a category is called.
    names = "".join(f"  {index}: {json.dumps(name)}\n" for index, name in enumerate(categories))
    # Without a path folders are those beside the file; "." would be wherever the training is started.
    content = f"train: images/train\nval: images/train\nnames:\n{names}"
    (out / "data.yaml").write_text(content, encoding="utf-8")
    return count


def box_of(mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "4"]:
    """Centre x and y, width and height of the tightest box, as shares of the picture."""
    left, top, width, height = box_xywh(mask)
    rows, columns = mask.shape
    return np.array([(left + width / 2) / columns, (top + height / 2) / rows, width / columns, height / rows])


def polygon_of(mask: Bool[np.ndarray, "h w"]) -> Float[np.ndarray, "n 2"]:
    """One outline of all pieces of a mask, x and y as shares of the picture, at least three points.

    Pieces are joined where they are nearest to each other, by a bridge there and back.
    """
    return joined_outline(mask) / np.array(mask.shape[::-1])
