"""The views of a report: which to show, and detections, pseudo-labels and ground truth of each side by side."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from labeling.core.episode import Episode
from labeling.core.rle import decode_mask
from labeling.evaluation.compare import Case, Evaluation
from labeling.evaluation.records import EpisodeRecords
from labeling.evaluation.report.errors import RIGHT_IOU, kinds_of
from labeling.evaluation.report.pictures import PALETTE, UNMATCHED, Overlay, panel, thumbnail
from labeling.generator.sources import with_source_detections
from labeling.io.episodes import read_episode
from labeling.io.label_set import View, recording_config
from labeling.metrics.matching import MaskInstance, instances_of, match
from labeling.runtime.cli import progress_bar

MAX_DRAWN = 16
"""Predictions drawn in one panel; a detector at every confidence may have a hundred."""

MAX_VIEWS_AN_EPISODE = 6


def choose_worst(cases: Sequence[Case], most: int) -> tuple[Case, ...]:
    """The worst cases, at most one a view, worst first.

    Args:
        cases: the worst first.
        most: how many to return at most.
    """
    first_of_view: dict[View, Case] = {}
    for case in cases:
        first_of_view.setdefault(case.view, case)
    return tuple(first_of_view.values())[:most]


def choose_improved(cases: Sequence[Case], most: int) -> tuple[Case, ...]:
    """The cases in which pseudo-labels are furthest above the detector, at most one a view, the furthest first.

    Args:
        cases: any.
        most: how many to return at most; fewer where fewer have improved.
    """
    better = [case for case in cases if case.pseudo_label_iou > case.detector_iou]
    better.sort(key=lambda case: (case.detector_iou - case.pseudo_label_iou, -case.area_px, case.view))
    return choose_worst(better, most)


def choose_views(episodes: Sequence[EpisodeRecords], most: int) -> dict[str, tuple[View, ...]]:
    """Views to show of each episode, evenly spread over its views; over the episodes too, where there are too many."""
    shown = [episodes[i] for i in _spread(len(episodes), most)]
    each = min(MAX_VIEWS_AN_EPISODE, most // len(shown)) if shown else 0
    return {episode.name: tuple(episode.views[i] for i in _spread(len(episode.views), each)) for episode in shown}


def _spread(count: int, most: int) -> list[int]:
    """At most ``most`` indices below ``count``, evenly apart."""
    if most <= 0 or count == 0:
        return []
    return sorted({int(i) for i in np.linspace(0, count - 1, min(count, most)).round()})


def draw_views(
    evaluation: Evaluation, max_views: int, max_worst: int, phantoms: Sequence[MaskInstance] = ()
) -> dict[str, Any]:
    """Reads the pictures of the views to be shown and draws them.

    Args:
        evaluation: what to show.
        max_views: views drawn at most, in all.
        max_worst: of those, how many for the worst cases, for the most improved, and for phantoms, each.
        phantoms: pseudo-labels where nothing is, the most confident first.

    Returns:
        What the template shows: by view the ``panels`` of detector, pseudo-labels and ground truth, and the IoU of its
        ``objects``; thumbnails; one case a view, the worst first, and the most improved first; phantoms, one a view;
        and by episode the views shown in its section.
    """
    worst = choose_worst(evaluation.cases, min(max_worst, max_views))
    improved = choose_improved(evaluation.cases, min(max_worst, max_views - len(worst)))
    first_of_view = {item.image: item for item in reversed(phantoms)}
    most = min(max_worst, max_views - len(worst) - len(improved))
    shown = sorted(first_of_view.values(), key=lambda item: -item.confidence)[:most]
    of_episode = choose_views(evaluation.episodes, max_views - len(worst) - len(improved) - len(shown))
    wanted = {case.view for case in [*worst, *improved]} | {item.image for item in shown}
    wanted |= {view for views in of_episode.values() for view in views}
    compared: dict[View, dict[str, Any]] = {}
    thumbnails = []
    for number, records in enumerate(progress_bar(evaluation.episodes, "episode", desc="drawing")):
        views = [view for view in records.views if view in wanted]
        if not views:
            continue
        provenance = evaluation.labels.provenance
        episode = read_episode(records.folder, recording_config(provenance))
        episode = with_source_detections(episode, evaluation.labels.folder, provenance)
        labels = [item for item in evaluation.labels.modal if item.image[0] == records.name]
        for view in views:
            image_id = f"e{number}v{view[1]}"
            thumbnails.append(thumbnail(image_id, episode.rgb[view[1]]))
            compared[view] = _compare(episode, records, view, [item for item in labels if item.image == view], image_id)
    return {
        "views": compared,
        "thumbnails": thumbnails,
        "worst": worst,
        "improved": improved,
        "phantoms": shown,
        "views_of_episode": of_episode,
    }


def _compare(
    episode: Episode, records: EpisodeRecords, view: View, labels: Sequence[MaskInstance], image_id: str
) -> dict[str, Any]:
    """Three panels and the objects' IoUs, of one view."""
    counted = {item.category for item in records.truths}
    truth = [
        replace(t, ignore=t.ignore or t.category not in counted)
        for t in episode.ground_truth or ()
        if t.view_index == view[1] and t.modal.any()
    ]
    truths = instances_of(view[0], truth)
    order = sorted({t.instance_id for t in episode.ground_truth or ()})
    colours = [PALETTE[order.index(t.instance_id) % len(PALETTE)] for t in truth]
    detections = instances_of(view[0], (d for d in episode.detections or () if d.view_index == view[1]))
    detected, detector_ious = _predictions(detections, truths, colours)
    labelled, label_ious = _predictions(labels, truths, colours)
    true = [
        Overlay(t.modal, UNMATCHED, f"{t.category} (ignored)", f"{t.category}, ignored in evaluation", True, t.category)
        if t.ignore
        else Overlay(
            t.modal,
            colour,
            t.category,
            f"{t.category}, object {t.instance_id}",
            category=t.category,
            kind="missed" if iou < RIGHT_IOU else "truth",
        )
        for t, colour, iou in zip(truth, colours, label_ious, strict=True)
    ]
    panels = [
        {
            "title": title,
            "drawn": len(overlays),
            "total": total,
            "svg": panel(image_id, episode.size, overlays, f"{title}, {view[0]}, view {view[1]}"),
        }
        for title, overlays, total in (
            ("Detector" if episode.detections is not None else "Detector (none ran here)", detected, len(detections)),
            ("Pseudo-labels", labelled, len(labels)),
            ("Ground truth", true, len(true)),
        )
    ]
    objects = [
        {"colour": colour, "category": t.category, "detector_iou": detector_iou, "pseudo_label_iou": label_iou}
        for t, colour, detector_iou, label_iou in zip(truth, colours, detector_ious, label_ious, strict=True)
        if not t.ignore
    ]
    return {"panels": panels, "objects": objects}


def _predictions(
    items: Sequence[MaskInstance], truths: Sequence[MaskInstance], colours: Sequence[str]
) -> tuple[list[Overlay], list[float]]:
    """Overlays of predictions in the colours of the objects they stand for, and the IoU each object reached."""
    matches = match(items, truths)
    kinds = kinds_of(items, truths, matches)
    partner = {m.prediction: m for m in matches if m.prediction is not None}
    # Those that stand for an object are drawn first of all; the rest by confidence, as far as there is room.
    ranked = sorted(range(len(items)), key=lambda i: (i not in partner, -items[i].confidence))[:MAX_DRAWN]
    overlays = []
    for index in ranked:
        item = items[index]
        tag = f"{item.category} {item.confidence:.2f}"
        mask = decode_mask(item.rle)
        found = partner.get(index)
        if found is None:
            shown = Overlay(mask, UNMATCHED, tag, f"{tag}, stands for no object of this category", dashed=True)
        elif truths[found.truth].ignore:
            shown = Overlay(mask, UNMATCHED, tag, f"{tag}, falls on an ignored object", dashed=True)
        else:
            shown = Overlay(mask, colours[found.truth], tag, f"{tag}, IoU {found.iou:.2f} with ground truth")
        overlays.append(replace(shown, category=item.category, kind=kinds[index], confidence=item.confidence))
    return overlays, [m.iou for m in matches]
