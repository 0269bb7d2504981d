"""Label sets as Hugging Face ``datasets`` reads them: a folder of pictures with ``metadata.jsonl``."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from labeling.core.masks import box_xywh
from labeling.exports.pictures import instance_map, write_png
from labeling.io.labelled_views import LabelledView

SPLIT = "train"


def write_hugging_face(out: Path, views: Iterable[LabelledView], categories: Sequence[str]) -> int:
    """Writes ``train/metadata.jsonl``, ``train/images`` and ``train/instances``; returns how many labels.

    ``load_dataset("imagefolder", data_dir=OUT)`` makes a row of each view: ``image``; ``instances``, a 16-bit picture
    with the instance id of every pixel, 0 for none, the surer one where masks overlap; ``objects``, lists of one length
    as in the datasets that object detectors are trained on there: ``id`` (instance id), ``bbox`` (left, top, width,
    height in pixels), ``area`` (pixels), ``category`` (index), ``category_name``, ``confidence``; and the camera:
    ``episode``, ``view``, ``intrinsics`` (K, pixels), ``camera_to_world`` (4x4, OpenCV axes).

    Args:
        out: an empty folder.
        views: to write.
        categories: their names, in the order of their indices.

    Raises:
        UsageError: if an instance id is below 1 or above 65535.
    """
    folder = out / SPLIT
    for kind in ("images", "instances"):
        (folder / kind).mkdir(parents=True)
    count = 0
    with (folder / "metadata.jsonl").open("w", encoding="utf-8") as file:
        for view in views:
            name = f"{view.name}.png"
            write_png(folder / "images" / name, view.rgb)
            write_png(folder / "instances" / name, instance_map(view))
            row = {
                "file_name": f"images/{name}",
                "instances_file_name": f"instances/{name}",
                "episode": view.episode,
                "view": view.index,
                "intrinsics": view.camera.intrinsics.tolist(),
                "camera_to_world": view.camera.camera_to_world.tolist(),
                "objects": _objects(view, categories),
            }
            file.write(json.dumps(row, allow_nan=False) + "\n")
            count += len(view.labels)
    return count


def _objects(view: LabelledView, categories: Sequence[str]) -> dict[str, list[Any]]:
    return {
        "id": [label.instance_id for label in view.labels],
        "bbox": [list(box_xywh(label.mask)) for label in view.labels],
        "area": [int(label.mask.sum()) for label in view.labels],
        "category": [categories.index(label.category) for label in view.labels],
        "category_name": [label.category for label in view.labels],
        "confidence": [label.confidence for label in view.labels],
    }
