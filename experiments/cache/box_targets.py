"""How good the 3-D boxes of labels are, by category, and what the fusion of many views is worth to them."""

import statistics
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from labeling.core.types import Box3d
    from labeling.detectors3d.frustum_samples import FrustumSample

NEAR_M = 1.5
"""An object whose centre is further from that of a label's box is not what the label means."""


def box_targets(labels: Path, episodes: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Compares boxes with those of the true objects.

    An object of a label set is compared with the nearest true object of its category in its episode; if there is none
    near, its overlap is 0: the label is of a wrong category. Beside its box stands the mean over views of what a single
    view gives: the box around the points of the label's mask in that view.

    Args:
        labels: a label set.
        episodes: that it was made from, with ground truth.

    Returns:
        By category: how many objects, the mean overlap of their boxes, the share that reach .5, the mean difference in
        heading of those that have an overlap of .25 (degrees, 0 to 45; for objects at least a quarter longer than
        wide 0 to 90; None if none has), and the mean overlap of boxes from single views.
    """
    from labeling.core.box_overlap import box_iou_3d
    from labeling.core.boxes3d import fit_box
    from labeling.detectors3d.frustum_samples import read_frustum_samples

    truths = _true_boxes(episodes)
    of_object: dict[tuple[Any, ...], list[FrustumSample]] = defaultdict(list)
    for one in read_frustum_samples(labels):
        of_object[(one.episode, one.category, *one.box.centre_m.tolist())].append(one)
    found: dict[str, list[dict[str, float]]] = defaultdict(list)
    for (episode, category, *_), samples in of_object.items():
        box = samples[0].box
        truth = _nearest(box, truths.get((episode, category), []))
        singles = []
        for sample in samples:
            single = fit_box(sample.frustum.points[sample.foreground].astype(float))
            if truth is not None and single is not None:
                singles.append(box_iou_3d(sample.frustum.to_world(single), truth))
        figures = {"iou": 0.0 if truth is None else box_iou_3d(box, truth), "single": _mean(singles)}
        if truth is not None and figures["iou"] >= 0.25:
            figures["heading"] = heading_apart_deg(box, truth)
        found[category].append(figures)
    return {name: _summary(some) for name, some in sorted(found.items())}


def heading_apart_deg(box: "Box3d", truth: "Box3d") -> float:
    """Angle between the longer sides of two upright boxes; between any sides if the true one is nearly square."""
    from labeling.detectors3d.upright_boxes import encode_box

    ours, true = encode_box(box), encode_box(truth)
    period = np.pi if true[3] >= 1.25 * true[4] else np.pi / 2
    apart = np.mod(ours[6] - true[6], period)
    return float(np.rad2deg(min(apart, period - apart)))


def _true_boxes(episodes: Sequence[Path]) -> "dict[tuple[str, str], list[Box3d]]":
    """By episode and category: scenes share their coordinates, so that others have objects at the same places."""
    from labeling.io.episodes import read_episode

    found: dict[tuple[str, str], dict[int, Box3d]] = defaultdict(dict)
    for folder in episodes:
        for one in read_episode(folder).ground_truth or ():
            if one.box_3d is not None:
                found[folder.resolve().name, one.category][one.instance_id] = one.box_3d
    return {key: list(boxes.values()) for key, boxes in found.items()}


def _nearest(box: "Box3d", truths: "Sequence[Box3d]") -> "Box3d | None":
    near = [(float(np.linalg.norm(one.centre_m - box.centre_m)), place) for place, one in enumerate(truths)]
    distance, place = min(near, default=(np.inf, -1))
    return truths[place] if distance <= max(NEAR_M, 0.5 * float(np.max(box.extent_m))) else None


def _mean(values: Sequence[float]) -> float:
    return statistics.fmean(values) if values else 0.0


def _summary(some: Sequence[dict[str, float]]) -> dict[str, Any]:
    headings = [one["heading"] for one in some if "heading" in one]
    return {
        "objects": len(some),
        "iou": _mean([one["iou"] for one in some]),
        "reach_half": _mean([float(one["iou"] >= 0.5) for one in some]),
        "heading_apart_deg": _mean(headings) if headings else None,
        "single_view_iou": _mean([one["single"] for one in some]),
    }
