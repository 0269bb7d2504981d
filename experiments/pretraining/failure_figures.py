"""How often a detector finds objects, by the conditions under which a view shows them."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import save
from experiments.pretraining.world_views import CONFIDENT
from labeling.core.detector import Detector, run_detector
from labeling.core.episode import Episode
from labeling.core.rle import encode_mask
from labeling.core.types import Box3d
from labeling.formats.atomic import atomic_file
from labeling.metrics.matching import MaskInstance, instances_of, match

CONDITIONS = ("side", "visible", "distance")
TITLES = {
    "side": "seen from (degrees from its front)",
    "visible": "share of it that nothing hides",
    "distance": "distance (m)",
}
EDGES: dict[str, dict[str, tuple[float, ...]]] = {
    "side": dict.fromkeys(("indoor", "outdoor"), (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)),
    "visible": dict.fromkeys(("indoor", "outdoor"), (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)),
    "distance": {"indoor": (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 8.0), "outdoor": (0.0, 4.0, 7.0, 10.0, 15.0, 25.0, 50.0)},
}
"""Bins of every condition in each kind of world."""
RIGHT_IOU = 0.5


@dataclass(frozen=True)
class ObjectView:
    """One object in one view, and whether it was found with its class and enough overlap."""

    category: str
    side: float
    """Degrees between the direction it faces and the direction it is seen from, 0 to 180."""
    visible: float
    """Share of what the view would show of it that nothing hides."""
    distance: float
    """From the camera to its centre, metres."""
    found: bool
    """By a detection of any confidence."""
    confident: bool
    """By a confident one."""


@dataclass(frozen=True)
class Bin:
    """The objects of one bin."""

    low: float
    high: float
    objects: int
    found: float | None
    """Share found, None if there are no objects."""
    confident: float | None
    """Share found with confidence."""


def find_objects(episode: Episode, detector: Detector) -> list[ObjectView]:
    """What a detector finds of every object in every view of an episode with ground truth."""
    known = None if detector.categories is None else set(detector.categories)
    with_box = [t for t in episode.ground_truth or () if not t.ignore and t.box_3d is not None]
    truths = [t for t in with_box if not known or t.category in known]
    found = instances_of(episode.name, run_detector(detector, episode))
    wanted = [MaskInstance((episode.name, t.view_index), t.category, encode_mask(t.modal)) for t in truths]
    right = [m.iou >= RIGHT_IOU for m in match(found, wanted)]
    sure = [m.iou >= RIGHT_IOU for m in match([item for item in found if item.confidence >= CONFIDENT], wanted)]
    objects = []
    for truth, is_found, is_sure in zip(truths, right, sure, strict=True):
        assert truth.box_3d is not None
        eye = episode.camera_to_world[truth.view_index][:3, 3]
        whole = truth.modal if truth.amodal is None else truth.amodal
        side, distance = seen_from_deg(truth.box_3d, eye), float(np.linalg.norm(eye - truth.box_3d.centre_m))
        visible = np.count_nonzero(truth.modal) / max(np.count_nonzero(whole), 1)
        objects.append(ObjectView(truth.category, side, visible, distance, is_found, is_sure))
    return objects


def seen_from_deg(box: Box3d, eye_m: Float[np.ndarray, "3"]) -> float:
    """Angle on the floor between an object's front (-Y of its box) and the direction to the camera, 0 to 180."""
    right, back = (np.asarray(box.rotation).T @ (eye_m - box.centre_m))[:2]
    return float(np.rad2deg(np.abs(np.arctan2(right, -back))))


def bin_by(objects: Sequence[ObjectView], condition: str, world: str) -> list[Bin]:
    """Objects by one condition.

    Args:
        objects: all objects in all views.
        condition: one of ``CONDITIONS``.
        world: "indoor" or "outdoor".
    """
    edges = EDGES[condition][world]
    values = np.array([getattr(one, condition) for one in objects])
    # The last bin holds its upper edge too.
    place = np.minimum(np.searchsorted(edges, values, side="right") - 1, len(edges) - 2)
    place[values > edges[-1]] = -1
    rows = []
    for number, (low, high) in enumerate(itertools.pairwise(edges)):
        chosen = [objects[k] for k in np.flatnonzero(place == number).tolist()]
        count = len(chosen)
        shares = [sum(getattr(c, name) for c in chosen) / count if count else None for name in ("found", "confident")]
        rows.append(Bin(low, high, count, shares[0], shares[1]))
    return rows


def wilson(share: float, count: int, z: float = 1.96) -> tuple[float, float]:
    """Confidence interval of a share. Source: Wilson 1927."""
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def draw_failures(tables: Mapping[str, Mapping[str, Sequence[Bin]]], path: Path) -> None:
    """Draws what share of objects is found, a row of panels for each kind of world.

    Args:
        tables: rows by world and condition.
        path: PNG to write.
    """
    figure, axes = plt.subplots(
        len(tables), len(CONDITIONS), figsize=(12.0, 3.1 * len(tables)), dpi=100, sharey=True, squeeze=False
    )
    for line, (world, conditions) in zip(axes, tables.items(), strict=True):
        for panel, name in zip(line, CONDITIONS, strict=True):
            _panel(panel, conditions[name])
            panel.set_xlabel(TITLES[name])
        line[0].set_ylabel(f"{world}: share of objects")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="upper center", ncols=2, frameon=False, fontsize=9)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.96))
    with atomic_file(path) as temporary:
        save(figure, temporary)


def _panel(axes: Axes, rows: Sequence[Bin]) -> None:
    labels = [f"{row.low:g}-{row.high:g}\nn={row.objects}" for row in rows]
    for name, colour, words in (
        ("found", "tab:blue", "found (IoU ≥ .5, right class)"),
        ("confident", "tab:orange", "found with confidence ≥ .9"),
    ):
        there = [(k, row, getattr(row, name)) for k, row in enumerate(rows) if row.objects]
        x, y = [k for k, _, _ in there], [share for _, _, share in there]
        ends = np.array([wilson(share, row.objects) for _, row, share in there]).reshape(-1, 2)
        spread = np.abs(ends.T - np.array(y))
        axes.errorbar(x, y, yerr=spread, color=colour, marker="o", capsize=2, linewidth=1.5, label=words)
    axes.set_xticks(range(len(rows)), labels, fontsize=7)
    axes.set_xlim(-0.5, len(rows) - 0.5)
    axes.set_ylim(0.0, 1.0)
    axes.grid(axis="y", alpha=0.3)
