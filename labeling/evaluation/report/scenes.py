"""The 3-D scenes of a report: clouds thinned out and packed, boxes, and the view that each opens at."""

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8

from labeling.core.types import BOX_EDGES, Box3d
from labeling.inspection.colouring import true_colours
from labeling.inspection.framing import below, cut_height_m, opening_view, region, spacing_m
from labeling.inspection.scene import LabelledScene

MAX_SCENES = 4
MAX_POINTS = 100_000
"""Of all scenes together: 1.5 megabytes of the page."""
MAX_POINTS_A_SCENE = 40_000
AROUND = 0.6
"""How far around its objects a scene is shown, as a share of the region they take up."""
FAR = 4
"""Points of objects are shown so many times as far around."""
FOV_RAD = 0.8
STEPS = 65535
"""Coordinates are whole numbers up to here, over the longest edge of what is shown."""


def pack_scenes(scenes: Sequence[LabelledScene]) -> list[dict[str, Any]]:
    """What the page's viewer needs of the first ``MAX_SCENES`` scenes, ready for JSON; lengths in metres."""
    shown = [scene for scene in scenes if len(scene.points)][:MAX_SCENES]
    return [_pack(scene, min(MAX_POINTS_A_SCENE, MAX_POINTS // len(shown))) for scene in shown]


def _pack(scene: LabelledScene, most: int) -> dict[str, Any]:
    centre, size_m = region(scene)
    reach = 0.5 * size_m + AROUND * size_m.max()
    away = np.abs(scene.points - centre)  # of places that are no numbers no comparison is true
    near = np.all(away <= reach, axis=1) | ((scene.labels > 0) & np.all(away <= FAR * reach, axis=1))
    kept = np.flatnonzero(near & below(scene, cut_height_m(scene)))
    kept = kept[thinned(scene.points[kept], most)]
    points = scene.points[kept]
    low = points.min(axis=0) if len(points) else centre
    scale_m = max(float(np.ptp(points, axis=0).max(initial=0.0)), 1e-3) / STEPS
    position, target = opening_view(scene, FOV_RAD)
    return {
        "name": scene.name,
        "count": len(kept),
        "scale": scale_m,
        "points": _base64(np.rint((points - low) / scale_m).astype("<u2")),
        "colours": _base64(np.rint(255 * true_colours(scene)[kept]).astype(np.uint8)),
        "numbers": _base64(scene.labels[kept].astype("<u2")),
        "spacing": spacing_m(points),
        "eye": _rounded(position - low),
        "target": _rounded(target - low),
        "fov": FOV_RAD,
        "edges": [list(edge) for edge in BOX_EDGES],
        "objects": [
            {
                "number": one.number,
                "title": one.title,
                "category": one.category,
                "confidence": one.confidence,
                "colour": [round(value, 3) for value in one.colour],
                "corners": _corners(one.box, low),
            }
            for one in scene.objects
        ],
        "truth": [{"category": one.category, "corners": _corners(one.box, low)} for one in scene.truth],
    }


def thinned(points: Float[np.ndarray, "n 3"], most: int) -> Int[np.ndarray, "m"]:
    """Indices of at most ``most`` points, evenly spread: one in each cell of the finest grid that does."""
    if len(points) <= most:
        return np.arange(len(points))
    cell_m = spacing_m(points)
    while True:
        cells = np.floor((points - points.min(axis=0)) / cell_m).astype(np.int64)
        _, first = np.unique(cells, axis=0, return_index=True)
        if len(first) <= most:
            return np.sort(first)
        cell_m *= max(1.05, (len(first) / most) ** 0.5)


def _corners(box: Box3d, origin_m: Float[np.ndarray, "3"]) -> list[float]:
    return _rounded((box.corners() - origin_m).ravel())


def _rounded(values: Float[np.ndarray, "n"]) -> list[float]:
    return [round(value, 3) for value in values.tolist()]


def _base64(values: UInt8[np.ndarray, "..."] | np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")
