"""Labels the thesis' way: every confident detection is segmented alone, and masks compete in the picture only.

Source: thesis 4.3 ("for clarity, we focus on one high confidence detection"; "if multiple confident input masks of the
same object are given, we keep the pixels corresponding to the most confident prediction at reprojection time").
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Int32

from labeling.core.boxes3d import fit_box
from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Scale, SegmentedCloud, Source
from labeling.core.masks import box_xyxy
from labeling.core.splatting import silhouettes
from labeling.core.types import Detection, PseudoLabel
from labeling.core.views import RgbdViews
from labeling.generator.cloud.outliers import segment_outliers
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.draw.fused_views import FusedViews, fill_reach_px
from labeling.generator.draw.view_masks import view_chances
from labeling.generator.objects.association import Candidate, associate_detections, is_consistent
from labeling.generator.objects.seeds import detection_seeds
from labeling.generator.segment.crf import ObjectCrf
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import with_label_defects

NMS_OVERLAP = 0.5
"""Masks of one class of which one covers this share of the other, and masks of two classes whose boxes have this IoU,
show the same thing. Source: published code."""


@dataclass(frozen=True)
class SegmentMasks:
    """What one segment looks like in one view."""

    segment: int
    """Index; segments are numbered from the most confident to the least."""
    category: str
    modal: Bool[np.ndarray, "h w"]
    amodal: Bool[np.ndarray, "h w"]


def single_detection_candidates(cloud: Cloud, detections: Sequence[Detection], config: LabelConfig) -> list[Candidate]:
    """Every confident detection as an object of its own, the most confident first.

    Args:
        cloud: the points.
        detections: of all views, confident or not.
        config: settings; with ``consistency`` only detections of objects that enough views agree on.
    """
    found = []
    for detection in detections:
        if detection.confidence >= config.confident:
            seeds = detection_seeds(cloud, detection, config)
            if len(seeds.foreground) > 0:
                found.append(seeds)
    if config.consistency:
        groups = associate_detections(found, cloud.num_points, config.merge_overlap)
        found = [one for group in groups if is_consistent(group, config.confident) for one in group.sources]
    found.sort(key=lambda one: (-one.detection.confidence, one.detection.view_index))
    return [Candidate.of(one, cloud.num_points) for one in found]


def label_per_detection(
    views: RgbdViews, cloud: Cloud, candidates: Sequence[Candidate], scale: Scale, config: LabelConfig
) -> EpisodeLabels:
    """Labels every view from segments that each stem from one detection.

    Args:
        views: of one scene.
        cloud: made from these views.
        candidates: of one detection each, as ``single_detection_candidates`` returns them.
        scale: of the episode.
        config: settings. ``exclusive``, ``weak_evidence`` and ``merge_overlap`` play no part: segments do not know of
            each other.

    Returns:
        One object for every detection that kept a mask in some view.
    """
    probability = _segment_each(cloud, candidates, scale, config)
    fused = FusedViews.of(views, cloud, np.any(probability > 0.5, axis=1), scale.pixel_m, config)
    sources = [candidate.sources[0].detection for candidate in candidates]
    labels = _draw_all(fused, sources, probability, scale, config)
    kept = sorted({label.instance_id for label in labels})
    instance_id = {segment: number for number, segment in enumerate(kept, start=1)}
    chance = probability[:, [segment - 1 for segment in kept]]
    objects = []
    for number, segment in enumerate(kept, start=1):
        detection = sources[segment - 1]
        source = Source(detection.view_index, float(detection.confidence), detection.category)
        members = cloud.points[chance[:, number - 1] > 0.5]
        box = fit_box(members, margin_m=cloud.voxel_m) if len(members) else None
        objects.append(LabelledObject(number, detection.category, source.confidence, box, (source,)))
    final = [replace(label, instance_id=instance_id[label.instance_id]) for label in labels]
    segmented = SegmentedCloud(cloud.points, cloud.colours, _first_owner(chance), chance)
    return EpisodeLabels(tuple(objects), with_label_defects(final, config.published), segmented, scale)


def _segment_each(
    cloud: Cloud, candidates: Sequence[Candidate], scale: Scale, config: LabelConfig
) -> Float32[np.ndarray, "n k"]:
    """Probability of each segment at every point; 0 outside its crop, whose points have a CRF of their own."""
    crf = ObjectCrf.of(cloud, candidates, scale, config)
    probability, active = crf.marginals(exclusive=False), crf.active
    for k in range(len(candidates)):
        points = active.point[active.rows_of(k)]
        owner = np.where(probability[points, k] > 0.5, 0, -1).astype(np.int32)
        gone = segment_outliers(cloud.points[points], owner, 1, cloud.voxel_m, config)
        probability[points[gone], k] = 0
    return probability


def _draw_all(
    fused: FusedViews,
    sources: Sequence[Detection],
    probability: Float32[np.ndarray, "n k"],
    scale: Scale,
    config: LabelConfig,
) -> list[PseudoLabel]:
    """Masks of all segments in all views, after the more confident have suppressed the others."""
    cloud, fine = fused.cloud, fused.fine
    inside = probability > 0.5
    points_of = [fine.points[inside[fine.voxel, k]] for k in range(len(sources))]
    reach_px = fill_reach_px(cloud.voxel_m, scale.pixel_m, config)
    labels = []
    for view, rgb in enumerate(fused.views.rgb):
        voxels = fused.visible_voxels(view, config)
        chances = view_chances(rgb, voxels, None, probability, reach_px, config.fill_edge)
        chance, known = chances.dense(), chances.known
        camera = fused.views.camera(view)
        drawn = []
        for k, source in enumerate(sources):
            modal = known & (chance[:, :, k] > 0.5)
            points = points_of[k]
            amodal = modal | silhouettes(points, np.zeros(len(points), np.int32), 1, camera, fine.spacing_m)[0]
            if config.published.missing_z_buffer:
                modal = amodal
            if modal.any():
                drawn.append(SegmentMasks(k, source.category, modal, amodal))
        for one in non_maximum_suppression(drawn, last_wins=config.published.missing_z_buffer):
            confidence = float(sources[one.segment].confidence)
            labels.append(
                PseudoLabel(
                    view_index=view,
                    instance_id=one.segment + 1,
                    category=one.category,
                    confidence=confidence,
                    modal=one.modal,
                    amodal=one.amodal,
                    source_view_index=sources[one.segment].view_index,
                    source_confidence=confidence,
                )
            )
    return labels


def non_maximum_suppression(drawn: Sequence[SegmentMasks], last_wins: bool = False) -> list[SegmentMasks]:
    """The masks of one view without those that a more confident one duplicates.

    Pixels that two of the kept masks claim go to the more confident one.

    Args:
        drawn: the most confident first.
        last_wins: give them to the last one drawn instead.
    """
    kept: list[SegmentMasks] = []
    for one in drawn:
        if not any(_is_duplicate(one, other) for other in kept):
            kept.append(one)
    taken, left = np.zeros(kept[0].modal.shape if kept else (), bool), []
    for one in reversed(kept) if last_wins else kept:
        modal = one.modal & ~taken
        taken = taken | one.modal
        if modal.any():
            left.append(SegmentMasks(one.segment, one.category, modal, one.amodal | modal))
    return sorted(left, key=lambda one: one.segment)


def _is_duplicate(a: SegmentMasks, b: SegmentMasks) -> bool:
    """Whether two masks of one view overlap so much that they show the same thing."""
    if a.category == b.category:
        shared = np.count_nonzero(a.modal & b.modal)
        return bool(shared >= NMS_OVERLAP * min(np.count_nonzero(a.modal), np.count_nonzero(b.modal)))
    box_a, box_b = np.array(box_xyxy(a.amodal)), np.array(box_xyxy(b.amodal))
    low, high = np.maximum(box_a[:2], box_b[:2]), np.minimum(box_a[2:], box_b[2:])
    shared = np.prod(np.maximum(high - low, 0))
    return bool(shared > NMS_OVERLAP * (np.prod(box_a[2:] - box_a[:2]) + np.prod(box_b[2:] - box_b[:2]) - shared))


def _first_owner(probability: Float32[np.ndarray, "n k"]) -> Int32[np.ndarray, "n"]:
    """Number of the most confident segment that holds a point, counted from 1; 0 for none."""
    inside = probability > 0.5
    if inside.shape[1] == 0:
        return np.zeros(len(inside), np.int32)
    return np.where(inside.any(axis=1), inside.argmax(axis=1) + 1, 0).astype(np.int32)
