"""Figures of episodes: views, detections, labels and clouds."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import save
from labeling.core.episode import Episode
from labeling.core.masks import mask_iou
from labeling.core.splatting import splat
from labeling.core.types import CONFIDENT, Detection, GroundTruth, PseudoLabel
from labeling.generator.cloud.object_scale import voxel_edge_m
from labeling.generator.objects.seeds import mask_trimap
from labeling.generator.propagate import EpisodeLabels, propagate
from labeling.generator.settings.label_config import LabelConfig
from labeling.inspection.titles import write_title

COLOURS = np.array(plt.get_cmap("tab10").colors)
DPI = 100
PARTLY_HIDDEN, FROM_ELSEWHERE = (0.1, 0.5), np.deg2rad(45)
"""Share of an object that something else hides, and angle between two gazes, that show best what labels do."""
NAMED_M = 0.5
"""Objects at least so long are named in plans: names of small ones lie over each other."""
MIN_DRAWN_CONFIDENCE = 0.1
"""Networks offer dozens of detections fainter than this, which would hide all others in a picture."""


def draw_episode(episodes: Sequence[Episode], path: Path) -> None:
    """The way of the agent around its object from above, and eight of its views.

    Args:
        episodes: the richest in directions of view is drawn.
        path: PNG to write.
    """
    episode = max(episodes, key=lambda e: e.metadata["steps"][-1]["coverage"])
    figure = plt.figure(figsize=(13.5, 4.4), dpi=DPI)
    grid = figure.add_gridspec(2, 6, left=0.01, right=0.99, top=0.93, bottom=0.02, wspace=0.04, hspace=0.12)
    _draw_way(figure.add_subplot(grid[:, :2]), episode)
    for cell, view in enumerate(_telling_views(episode, 8)):
        axes = figure.add_subplot(grid[cell // 4, 2 + cell % 4])
        confident = [d for d in episode.detections or () if d.view_index == view and d.confidence >= CONFIDENT]
        _show(axes, _outlined(episode.rgb[view], [d.mask for d in confident]))
        names = ", ".join(f"{d.category} {d.confidence:.2f}" for d in confident) or "not confident"
        axes.set_title(f"view {view + 1}: {names}", fontsize=7.5, pad=3)
    save(figure, path)


def draw_label_steps(episodes: Sequence[Episode], path: Path) -> None:
    """Source view, seeds, unary and CRF in a view where the detector is unsure, and the masks that follow.

    Args:
        episodes: drawn is the object for which propagation gains most over the detector.
        path: PNG to write.
    """
    episode, label, detection = _greatest_gain(episodes)
    view, source = label.view_index, label.source_view_index
    panels: list[tuple[str, UInt8[np.ndarray, "h w 3"]]] = [
        (f"source: {label.category} {label.source_confidence:.2f}", _outlined(episode.rgb[source], [detection.mask])),
        ("seeds: safe object, safe background", _seeds(episode.rgb[source], detection)),
        ("unary, in another view", _probability(episode, label, replace(LabelConfig(), iterations=0))),
        ("after the CRF", _probability(episode, label, LabelConfig())),
        ("modal mask", _outlined(episode.rgb[view], [label.modal])),
        ("amodal mask", _outlined(episode.rgb[view], [label.amodal])),
    ]
    figure, axes = plt.subplots(2, len(panels) // 2, figsize=(10.2, 7.1), dpi=DPI)
    for axis, (title, picture) in zip(axes.flat, panels, strict=True):
        _show(axis, picture)
        axis.set_title(title, fontsize=10, pad=4)
    figure.subplots_adjust(left=0.005, right=0.995, top=0.96, bottom=0.005, wspace=0.02, hspace=0.1)
    save(figure, path)


def draw_labels(episodes: Sequence[Episode], path: Path) -> None:
    """Detection, pseudo-label and ground truth of one view of each episode.

    Args:
        episodes: of each, the view in which labels gain most over the detector.
        path: PNG to write.
    """
    figure, axes = plt.subplots(3, len(episodes), figsize=(3.3 * len(episodes), 10.1), dpi=DPI, squeeze=False)
    for column, episode in enumerate(episodes):
        labels = propagate(episode, episode.detections)
        view = max(range(episode.num_views), key=lambda v: _gain(episode, labels, v))
        detections = [one for one in episode.detections or () if one.confidence >= MIN_DRAWN_CONFIDENCE]
        truth = [t for t in episode.ground_truth or () if t.view_index == view and not t.ignore]
        rows: dict[str, Sequence[Detection | PseudoLabel | GroundTruth]] = {
            f"detector (confidence ≥ {MIN_DRAWN_CONFIDENCE})": [one for one in detections if one.view_index == view],
            "pseudo-labels": [m for m in labels.labels if m.view_index == view and m.modal.any()],
            "ground truth": truth,
        }
        for row, (name, items) in enumerate(rows.items()):
            _show(axes[row, column], named(episode.rgb[view], items, truth))
            axes[row, column].set_title(name, fontsize=9, pad=3)
    figure.subplots_adjust(left=0.005, right=0.995, top=0.975, bottom=0.005, wspace=0.02, hspace=0.08)
    save(figure, path)


# Parts ---------------------------------------------------------------------------------------------------------------


def _draw_way(axes: Axes, episode: Episode) -> None:
    """Objects' boxes and camera positions from above; views with a confident detection are filled."""
    boxes = {t.instance_id: t for t in episode.ground_truth or () if t.box_3d is not None}
    for truth in boxes.values():
        assert truth.box_3d is not None
        corners = truth.box_3d.corners()[[0, 2, 6, 4], :2]
        axes.fill(*corners.T, facecolor="0.88", edgecolor="0.5", linewidth=0.8)
        if max(truth.box_3d.extent_m[:2]) >= NAMED_M:
            axes.annotate(truth.category, corners.mean(axis=0), ha="center", va="center", fontsize=7, color="0.25")
    eyes, forward = episode.camera_to_world[:, :2, 3], episode.camera_to_world[:, :2, 2]
    sure = {d.view_index for d in episode.detections or () if d.confidence >= CONFIDENT}
    axes.plot(*eyes.T, color=COLOURS[0], linewidth=0.8, alpha=0.6)
    axes.quiver(*eyes.T, *forward.T, color=COLOURS[0], width=0.004, scale=18, headwidth=5)
    colours = [COLOURS[2] if view in sure else (1.0, 1.0, 1.0) for view in range(episode.num_views)]
    axes.scatter(*eyes.T, s=24, c=colours, edgecolors=[COLOURS[0]], linewidths=0.9, zorder=3)
    axes.scatter(*eyes[0], s=110, facecolors="none", edgecolors=[COLOURS[3]], linewidths=1.6, zorder=4)
    axes.annotate("start", eyes[0], (6, 6), textcoords="offset points", fontsize=8, color=COLOURS[3])
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title("the way from above; green: a confident view", fontsize=8, pad=3)


def _telling_views(episode: Episode, count: int) -> list[int]:
    """Views spread over an episode, with the first confident one among them, which is where the circle begins."""
    views = np.linspace(0, episode.num_views - 1, count).round().astype(int).tolist()
    sure = [one.view_index for one in episode.detections or () if one.confidence >= CONFIDENT]
    if sure and min(sure) not in views:
        nearest = min(range(1, count), key=lambda place: abs(views[place] - min(sure)))
        views[nearest] = min(sure)
    return sorted(views)


def _masks(items: Iterable[Detection | PseudoLabel | GroundTruth], view: int, category: str) -> list[np.ndarray]:
    """Modal masks of a category in a view."""
    some = [one for one in items if (one.view_index, one.category) == (view, category)]
    return [one.mask if isinstance(one, Detection) else one.modal for one in some]


def _best_iou(masks: Sequence[Bool[np.ndarray, "h w"]], truth: Bool[np.ndarray, "h w"]) -> float:
    return max((mask_iou(mask, truth) for mask in masks), default=0.0)


def _gain(episode: Episode, labels: EpisodeLabels, view: int) -> float:
    """Sum over the objects of a view of how much better the best label fits than the best detection."""
    gain = 0.0
    for truth in episode.ground_truth or ():
        if truth.view_index == view and not truth.ignore:
            made, found = (_masks(some or (), view, truth.category) for some in (labels.labels, episode.detections))
            gain += _best_iou(made, truth.modal) - _best_iou(found, truth.modal)
    return gain


def _greatest_gain(episodes: Sequence[Episode]) -> tuple[Episode, PseudoLabel, Detection]:
    """The label that most exceeds what the detector says of the same object in the same view, and its source."""
    best: tuple[float, Episode, PseudoLabel, Detection] | None = None
    for episode in episodes:
        detections = episode.detections or ()
        for label in propagate(episode, detections).labels:
            came_from = label.source_view_index, label.source_confidence
            sure = (one for one in detections if one.confidence >= CONFIDENT)  # as the text beside the picture says
            sources = [one for one in sure if (one.view_index, one.confidence) == came_from]
            if not sources or label.view_index == label.source_view_index:
                continue
            found = _masks(detections, label.view_index, label.category)
            where = label.view_index, label.category
            truths = [one for one in episode.ground_truth or () if (one.view_index, one.category) == where]
            score = max(
                (
                    (mask_iou(label.modal, one.modal) - _best_iou(found, one.modal))
                    * mask_iou(label.amodal, one.amodal)
                    for one in truths
                    if one.amodal is not None
                ),
                default=0.0,
            )
            # A sliver may gain as much as a large object, but shows nothing to a reader; nor does a view from where the
            # source stands, or of an object that nothing hides.
            score *= min(1.0, np.count_nonzero(label.modal) / (0.05 * label.modal.size))
            hidden = 1 - np.count_nonzero(label.modal) / max(1, np.count_nonzero(label.amodal))
            gazes = episode.camera_to_world[[label.view_index, label.source_view_index], :3, 2]
            turned = np.arccos(np.clip(gazes[0] @ gazes[1], -1, 1))
            score *= (1.0 if PARTLY_HIDDEN[0] <= hidden <= PARTLY_HIDDEN[1] else 0.02) * min(
                1.0, turned / FROM_ELSEWHERE
            )
            if best is None or score > best[0]:
                best = (score, episode, label, sources[0])
    if best is None:
        raise ValueError("none of the episodes has a label in a view other than its source, which was sure")
    return best[1:]


def _probability(episode: Episode, label: PseudoLabel, config: LabelConfig) -> UInt8[np.ndarray, "h w 3"]:
    """Probability of a label's object, as colours over the view."""
    labels = propagate(episode, episode.detections, config)
    cloud, view, came_from = labels.cloud, label.view_index, (label.category, label.source_view_index)
    matching = [k for k, one in enumerate(labels.objects) if (one.category, one.sources[0].view_index) == came_from]
    size_m = 1.5 * voxel_edge_m(labels.scale, config) if labels.scale else 0.0
    drawn = splat(cloud.points, episode.camera(view), size_m)
    probability = cloud.probability[:, matching[0]] if matching else np.zeros(len(cloud.points))
    values = np.where(drawn >= 0, probability[np.maximum(drawn, 0)], 0.0)
    heat = plt.get_cmap("viridis")(values)[:, :, :3]
    return (255 * (0.35 * episode.rgb[view] / 255 + 0.65 * heat)).round().astype(np.uint8)


def _seeds(rgb: UInt8[np.ndarray, "h w 3"], detection: Detection) -> UInt8[np.ndarray, "h w 3"]:
    config = LabelConfig()
    foreground, background, _ = mask_trimap(detection.mask, config.erode, config.dilate).over(detection.mask.shape)
    return _tinted(_tinted(rgb, background, COLOURS[0], 0.45), foreground, COLOURS[1], 0.6)


def named(
    rgb: UInt8[np.ndarray, "h w 3"],
    items: Sequence[Detection | PseudoLabel | GroundTruth],
    truths: Sequence[GroundTruth],
) -> UInt8[np.ndarray, "h w 3"]:
    """Masks in the colour of the object they fit best, with their names; grey where they fit none."""
    picture = cv2.resize(rgb, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    order = sorted({t.instance_id for t in truths})
    for item in items:
        mask = item.mask if isinstance(item, Detection) else item.modal
        fits = [(mask_iou(mask, t.modal), order.index(t.instance_id)) for t in truths if t.category == item.category]
        iou, rank = max(fits, default=(0.0, -1))
        colour = COLOURS[rank % len(COLOURS)] if iou > 0.1 else np.full(3, 0.55)
        picture = _outlined(picture, [_doubled(mask)], colour)
    for item in items:
        mask = item.mask if isinstance(item, Detection) else item.modal
        confidence = "" if isinstance(item, GroundTruth) else f" {item.confidence:.2f}"
        rows, columns = np.nonzero(_doubled(mask))
        write_title(picture, f"{item.category}{confidence}", (float(columns.mean()), float(rows.mean())))
    return picture


def _doubled(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h2 w2"]:
    return mask.repeat(2, axis=0).repeat(2, axis=1)


def _outlined(
    rgb: UInt8[np.ndarray, "h w 3"],
    masks: Sequence[Bool[np.ndarray, "h w"]],
    colour: Float[np.ndarray, "3"] | None = None,
) -> UInt8[np.ndarray, "h w 3"]:
    picture = rgb.copy()
    for number, mask in enumerate(masks):
        one = COLOURS[(number + 1) % len(COLOURS)] if colour is None else colour
        picture = _tinted(picture, mask, one, 0.4)
        contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, contours, -1, tuple(int(255 * c) for c in one), 1, cv2.LINE_AA)
    return picture


def _tinted(
    rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], colour: Float[np.ndarray, "3"], share: float
) -> UInt8[np.ndarray, "h w 3"]:
    picture = rgb.copy()
    picture[mask] = ((1 - share) * picture[mask] + share * 255 * np.asarray(colour)).round()
    return picture


def _show(axes: Axes, picture: UInt8[np.ndarray, "h w 3"]) -> None:
    axes.imshow(picture)
    axes.axis("off")
