"""Label sets as FiftyOne reads them: its own layout with masks, and its layout of labelled boxes beside it."""

import base64
import io
import zlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from labeling.core.masks import box_xywh
from labeling.exports.pictures import write_png
from labeling.formats.atomic import write_json, write_records
from labeling.io.labelled_views import LabelledView, ViewLabel

FIELD = "pseudo_labels"
"""Of a sample: its detections."""


def write_fiftyone(out: Path, views: Iterable[LabelledView], categories: Sequence[str]) -> int:
    """Writes ``data``, ``samples.json`` with ``metadata.json``, and ``labels.json``; returns how many labels.

    The folder is a ``fiftyone.types.FiftyOneDataset`` as JSON of its samples, the form without a version of
    FiftyOne's database, and a ``fiftyone.types.FiftyOneImageDetectionDataset``, whose ``labels.json`` has boxes and
    confidences only. Boxes are left, top, width, height as shares of the picture; masks are those of the pixels inside
    the box. ``index`` is the instance id, ``episode`` and ``view`` say where a picture is from.

    Args:
        out: an empty folder.
        views: to write.
        categories: their names, in the order of their indices in ``labels.json``.
    """
    (out / "data").mkdir()
    samples: list[dict[str, Any]] = []
    boxes_of: dict[str, list[dict[str, Any]]] = {}
    for view in views:
        file = f"data/{view.name}.png"
        write_png(out / file, view.rgb)
        found = [_detection(label) for label in view.labels]
        samples.append(_sample(view, file, (out / file).stat().st_size, found))
        boxes_of[view.name] = [
            {
                "label": categories.index(one["label"]),
                "bounding_box": one["bounding_box"],
                "confidence": one["confidence"],
                "attributes": {"index": one["index"]},  # FiftyOne keeps instance_id for itself
            }
            for one in found
        ]
    write_json(out / "metadata.json", {"media_type": "image", "info": {"classes": list(categories)}})
    write_records(out / "samples.json", {"samples": samples})
    write_json(out / "labels.json", {"classes": list(categories), "labels": boxes_of})
    return sum(map(len, boxes_of.values()))


def _sample(view: LabelledView, file: str, size_bytes: int, detections: list[dict[str, Any]]) -> dict[str, Any]:
    height_px, width_px = view.rgb.shape[:2]
    about = {
        "_cls": "ImageMetadata",
        "size_bytes": size_bytes,
        "mime_type": "image/png",
        "width": width_px,
        "height": height_px,
        "num_channels": 3,
    }
    return {
        "filepath": file,
        "tags": [],
        "metadata": about,
        "_media_type": "image",
        "episode": view.episode,
        "view": view.index,
        FIELD: {"_cls": "Detections", "detections": detections},
    }


def _detection(label: ViewLabel) -> dict[str, Any]:
    left, top, width, height = box_xywh(label.mask)
    rows, columns = label.mask.shape
    inside = label.mask[int(top) : int(top + height), int(left) : int(left + width)]
    return {
        "_cls": "Detection",
        "attributes": {},
        "tags": [],
        "label": label.category,
        "bounding_box": [left / columns, top / rows, width / columns, height / rows],
        "mask": {"$binary": {"base64": _packed(inside), "subType": "00"}},
        "confidence": label.confidence,
        "index": label.instance_id,
    }


def _packed(mask: Bool[np.ndarray, "h w"]) -> str:
    """A mask as FiftyOne stores arrays: an NPY file, zlib, base64."""
    with io.BytesIO() as file:
        np.save(file, mask, allow_pickle=False)
        return base64.b64encode(zlib.compress(file.getvalue())).decode("ascii")
