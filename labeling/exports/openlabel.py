"""Label sets as ASAM OpenLABEL 1.0.0: one JSON file an episode, with 2-D boxes, polygons, cuboids and cameras."""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from labeling.core.errors import LabelFormatError
from labeling.core.masks import box_xywh
from labeling.core.types import Box3d
from labeling.exports.outlines import outlines
from labeling.exports.pictures import write_png
from labeling.formats.atomic import write_json
from labeling.io.labelled_views import LabelledView, ViewLabel

SCHEMA_VERSION = "1.0.0"
WORLD, CAMERA = "world", "camera"
"""Names of coordinate systems; the camera's is also the name of its stream."""
BOX, MASK, CUBOID, CONFIDENCE = "box", "mask", "box_3d", "confidence"
"""Names of object data, and of the attribute of boxes."""
_COMMENT = (
    "Pseudo-labels. Metres; the world's +Z is up, the camera's axes are OpenCV's (+X right, +Y down, +Z forward). "
    "Coordinates of pixels are those of camera_matrix: the centre of the first pixel is at 0."
)


def write_openlabel(out: Path, views: Iterable[LabelledView]) -> int:
    """Writes ``EPISODE.json`` for each episode and all pictures into ``images``; returns how many labels.

    Frames are numbered as the views of the episode. Each has its camera (stream and transform to the world) and its
    objects with ``bbox`` (centre, width and height in pixels, confidence as an attribute) and ``poly2d`` (pieces of the
    mask, and its holes with the piece around them as their parent). Objects keep their instance ids; what has a 3-D box
    has it as ``cuboid`` in the world: centre, quaternion (x, y, z, w), full edge lengths.

    Args:
        out: an empty folder.
        views: to write, those of an episode one after the other.

    Raises:
        LabelFormatError: if an object has two categories, or stands twice in one view.
    """
    (out / "images").mkdir()
    count = 0
    for episode, of_episode in itertools.groupby(views, key=lambda view: view.episode):
        frames: dict[str, dict[str, Any]] = {}
        seen: dict[int, ViewLabel] = {}
        numbers: dict[int, list[int]] = {}
        for view in of_episode:
            file = f"images/{view.name}.png"
            write_png(out / file, view.rgb)
            for label in view.labels:
                _note(label, view, seen, numbers)
            frames[str(view.index)] = _frame(view, file)
            count += len(view.labels)
        objects = {str(number): _object(label, numbers[number]) for number, label in seen.items()}
        content = {
            "metadata": {
                "schema_version": SCHEMA_VERSION,
                "name": episode,
                "annotator": "Seeing by Moving",
                "comment": _COMMENT,
            },
            "coordinate_systems": {
                WORLD: {"type": "scene_cs", "parent": "", "children": [CAMERA]},
                CAMERA: {"type": "sensor_cs", "parent": WORLD},
            },
            "streams": {CAMERA: {"type": "camera", "description": "colour"}},
            "frame_intervals": _intervals(sorted(map(int, frames))),
            "frames": frames,
            "objects": objects,
        }
        write_json(out / f"{episode}.json", {"openlabel": content})
    return count


def _note(label: ViewLabel, view: LabelledView, seen: dict[int, ViewLabel], numbers: dict[int, list[int]]) -> None:
    """Takes note of an object in a view.

    Raises:
        LabelFormatError: if it had another category, or has been in this view.
    """
    number = label.instance_id
    first, frames = seen.setdefault(number, label), numbers.setdefault(number, [])
    named = f"object {number} of episode {view.episode!r}"
    if first.category != label.category:
        raise LabelFormatError(f"{named} is called {first.category!r} and, in view {view.index}, {label.category!r}")
    if view.index in frames:
        raise LabelFormatError(f"{named} stands twice in view {view.index}")
    frames.append(view.index)


def _frame(view: LabelledView, file: str) -> dict[str, Any]:
    height_px, width_px = view.camera.size
    matrix = np.c_[view.camera.intrinsics, np.zeros(3)]
    pinhole = {"width_px": width_px, "height_px": height_px, "camera_matrix": matrix.ravel().tolist()}
    pose = {"matrix4x4": view.camera.camera_to_world.ravel().tolist()}
    return {
        "frame_properties": {
            "streams": {CAMERA: {"uri": file, "stream_properties": {"intrinsics_pinhole": pinhole}}},
            "transforms": {f"{CAMERA}_to_{WORLD}": {"src": CAMERA, "dst": WORLD, "transform_src_to_dst": pose}},
        },
        "objects": {str(label.instance_id): {"object_data": _in_view(label)} for label in view.labels},
    }


def _in_view(label: ViewLabel) -> dict[str, Any]:
    left, top, width, height = box_xywh(label.mask)
    centre = [left + (width - 1) / 2, top + (height - 1) / 2]
    sure = {"num": [{"name": CONFIDENCE, "val": label.confidence}]}
    polygons = []
    for index, outline in enumerate(outlines(label.mask)):
        polygon: dict[str, Any] = {
            "name": f"{MASK}_{index}",
            "val": (outline.points_px - 0.5).ravel().tolist(),
            "mode": "MODE_POLY2D_ABSOLUTE",
            "closed": True,
        }
        # OpenCV's: next, previous, first child, parent; only the parent is told.
        polygon["hierarchy"] = [-1, -1, -1, -1 if outline.parent is None else outline.parent]
        polygons.append(polygon)
    return {"bbox": [{"name": BOX, "val": [*centre, width, height], "attributes": sure}], "poly2d": polygons}


def _object(label: ViewLabel, frames: Sequence[int]) -> dict[str, Any]:
    intervals = _intervals(frames)
    found: dict[str, Any] = {
        "name": f"{label.category} {label.instance_id}",
        "type": label.category,
        "frame_intervals": intervals,
        "object_data_pointers": {
            BOX: {"type": "bbox", "frame_intervals": intervals, "attribute_pointers": {CONFIDENCE: "num"}}
        },
    }
    if label.box_3d is not None:
        found["object_data"] = {"cuboid": [{"name": CUBOID, "coordinate_system": WORLD, "val": _cuboid(label.box_3d)}]}
    return found


def _cuboid(box: Box3d) -> list[float]:
    """x, y, z, quaternion x, y, z, w, edge lengths."""
    turn = Rotation.from_matrix(box.rotation).as_quat()
    return [*box.centre_m.tolist(), *turn.tolist(), *box.extent_m.tolist()]


def _intervals(frames: Sequence[int]) -> list[dict[str, int]]:
    """Runs of consecutive numbers, in order, both ends included."""
    found: list[dict[str, int]] = []
    for frame in sorted(frames):
        if found and found[-1]["frame_end"] == frame - 1:
            found[-1]["frame_end"] = frame
        else:
            found.append({"frame_start": frame, "frame_end": frame})
    return found
