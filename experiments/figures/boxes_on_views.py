"""3-D boxes on views and from above, as the thesis' figure 5.4."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from labeling.core.episode import Episode
from labeling.core.types import Box3d
from labeling.detectors3d.base import Detection3d

RECORD = "boxes_{}"
"""Of the picture and of the record, by world."""
MIN_CONFIDENCE = 0.3
"""Detections in the picture from this confidence on are lifted: the same for all."""
EDGES = [(0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
"""Of a box, between its corners."""
FOOTPRINT = [0, 2, 6, 4, 0]
"""Corners around a box from above."""
FOUND, TRUE, HALO = (31, 160, 84), (20, 20, 20), (255, 255, 255)


def busiest_view(episode: Episode, categories: Sequence[str]) -> int:
    """The first of the views with the most objects."""
    return max(range(episode.num_views), key=lambda view: len(true_boxes(episode, view, categories)))


def true_boxes(episode: Episode, view: int, categories: Sequence[str]) -> list[Box3d]:
    """Of the objects that a view shows."""
    return [
        one.box_3d
        for one in episode.ground_truth or ()
        if one.view_index == view and one.category in categories and one.box_3d is not None and not one.ignore
    ]


def draw(panels: Sequence[tuple[Episode, int, dict[str, list[Detection3d]], list[Box3d]]], path: Path) -> None:
    """For each view a row: for each detector the view with boxes, and boxes from above.

    Args:
        panels: episode, view, boxes by detector, true boxes.
        path: PNG to write.
    """
    from matplotlib import pyplot as plt

    from experiments.figures.style import save
    from labeling.formats.atomic import atomic_file

    names = list(panels[0][2])
    height, width = panels[0][0].size
    ratio = width / height
    figure, axes = plt.subplots(
        len(panels),
        2 * len(names),
        figsize=(2.4 * len(names) * (ratio + 1), 2.5 * len(panels)),
        gridspec_kw={"width_ratios": [ratio, 1] * len(names)},
        dpi=80,
        layout="constrained",
        squeeze=False,
    )
    for row, (episode, view, found, truths) in enumerate(panels):
        for number, name in enumerate(names):
            on_view, above = axes[row, 2 * number], axes[row, 2 * number + 1]
            boxes = [one.box for one in found[name]]
            on_view.imshow(boxes_on_view(episode, view, boxes, truths))
            on_view.axis("off")
            if row == 0:
                on_view.set_title(name, fontsize=11)
                above.set_title("from above", fontsize=9)
            _from_above(above, episode, view, boxes, truths)
    with atomic_file(path) as temporary:
        save(figure, temporary)


def boxes_on_view(
    episode: Episode, view: int, boxes: Sequence[Box3d], truths: Sequence[Box3d]
) -> UInt8[np.ndarray, "h w 3"]:
    """A view with the edges of boxes: true ones dark with light edges, to be seen on anything, found ones green."""
    import cv2

    grow = max(1, round(512 / episode.size[0]))
    picture = np.ascontiguousarray(np.kron(episode.rgb[view], np.ones((grow, grow, 1), np.uint8)))
    for some, colour, thickness in ((truths, HALO, 5), (truths, TRUE, 2), (boxes, FOUND, 3)):
        for box in some:
            for a, b in edges_in_view(box, episode.intrinsics[view], episode.camera_to_world[view]):
                start, end = (tuple(round(grow * (float(side) + 0.5)) for side in point) for point in (a, b))
                cv2.line(picture, start, end, colour, thickness, cv2.LINE_AA)
    return picture


def edges_in_view(
    box: Box3d, intrinsics: Float[np.ndarray, "3 3"], camera_to_world: Float[np.ndarray, "4 4"], near_m: float = 0.05
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The edges of a box as lines in the picture, cut off before the camera; pixels (x, y)."""
    local = (box.corners() - camera_to_world[:3, 3]) @ camera_to_world[:3, :3]
    lines = []
    for first, second in EDGES:
        a, b = local[first], local[second]
        if max(a[2], b[2]) <= near_m:
            continue
        if a[2] < near_m:
            a = a + (b - a) * (near_m - a[2]) / (b[2] - a[2])
        if b[2] < near_m:
            b = b + (a - b) * (near_m - b[2]) / (a[2] - b[2])
        pixels = [np.clip((intrinsics @ point)[:2] / point[2], -1e4, 1e4) for point in (a, b)]
        lines.append((pixels[0], pixels[1]))
    return lines


def _from_above(axes: Any, episode: Episode, view: int, boxes: Sequence[Box3d], truths: Sequence[Box3d]) -> None:
    """Footprints and the points of the view, the camera below and looking up."""
    from labeling.core.geometry import unproject_depth

    pose = episode.camera_to_world[view]
    c, s = pose[:2, 2] / np.hypot(*pose[:2, 2])
    turn = np.array([[s, -c], [c, s]])

    def local(points: np.ndarray) -> np.ndarray:
        return (points[:, :2] - pose[:2, 3]) @ turn.T

    points, _ = unproject_depth(episode.depth_m[view], episode.intrinsics[view], pose)
    low = points[(points[:, 2] < pose[2, 3] + 0.5) & (points[:, 2] > points[:, 2].min() + 0.1)]
    dots = local(low[:: max(1, len(low) // 4000)])
    axes.plot(dots[:, 0], dots[:, 1], ",", color="#b0b6bd")
    for some, colour, thick in ((truths, "black", 1.8), (boxes, "#1fa054", 1.6)):
        for box in some:
            outline = local(box.corners()[FOOTPRINT])
            axes.plot(outline[:, 0], outline[:, 1], color=colour, linewidth=thick)
    far = max([3.0, *(1.15 * float(local(box.corners())[:, 1].max()) for box in [*truths, *boxes])])
    far = min(far, 40.0)
    axes.set_xlim(-0.6 * far, 0.6 * far)
    axes.set_ylim(-0.05 * far, 1.15 * far)
    axes.plot(0, 0, "^", color="#b3372f", markersize=5)
    axes.set_aspect("equal")
    axes.tick_params(labelsize=6)
