"""The label generator: a few confident detections become masks of every object in every view of an episode.

    from labeling.generator.propagate import propagate
    labels = propagate(rgb, depth_m, intrinsics, camera_to_world, detections)
    labels.labels[0].modal

Source: thesis 4.3 and figure 4.1; what goes beyond it is told in docs/how-it-works.md.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from labeling.core.boxes3d import fit_box
from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Scale, SegmentedCloud, Source
from labeling.core.types import Detection, PseudoLabel
from labeling.generator.cloud.free_space import Cameras, clear_free_space
from labeling.generator.cloud.object_scale import measure_scale, voxel_edge_m
from labeling.generator.cloud.outliers import segment_outliers
from labeling.generator.cloud.voxel_cloud import Cloud, build_cloud
from labeling.generator.draw.splatting import nearest_points, silhouettes
from labeling.generator.draw.view_masks import modal_masks, view_probabilities
from labeling.generator.draw.visibility import Views, fill_reach_px, visible_voxels
from labeling.generator.objects.association import (
    Candidate,
    assign_weak_detections,
    associate_detections,
    group_segments,
    objects_by_agreement,
)
from labeling.generator.objects.consistency import is_consistent
from labeling.generator.objects.seeds import DetectionSeeds, detection_seeds
from labeling.generator.quality.finalise import finalise_labels
from labeling.generator.segment.active_points import ActivePoints
from labeling.generator.segment.pairwise_kernels import crf_kernels
from labeling.generator.segment.unary_potentials import UNREACHABLE_LOG_ODDS, object_log_odds
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import paint_in_order, with_label_defects
from labeling.generator.thesis.per_detection import label_per_detection, single_detection_candidates
from labeling.runtime.threads import in_background, in_threads

FINE_PX = 2.0
"""Spacing of the points that masks are drawn from, in pixels: as fine as depth sensors sample."""
MAX_FINE_POINTS = 3_000_000
"""Bounds the memory for them."""
BOX_MARGIN_VOXELS = 0.75
"""Added to the sides of 3-D boxes: points are means over voxels, and the outermost ones are trimmed."""


def propagate(
    rgb: UInt8[np.ndarray, "views h w 3"],
    depth_m: Float32[np.ndarray, "views h w"],
    intrinsics: Float[np.ndarray, "views 3 3"],
    camera_to_world: Float[np.ndarray, "views 4 4"],
    detections: Sequence[Detection],
    config: LabelConfig | None = None,
) -> EpisodeLabels:
    """Labels every view of an episode from its confident detections.

    Args:
        rgb: colour of the views.
        depth_m: z-depth, 0 where there is no return; may be sparse.
        intrinsics: K of each view, pixels.
        camera_to_world: pose of each view, OpenCV axes.
        detections: of all views, confident or not, with masks of the views' size.
        config: settings; the defaults if None.

    Returns:
        Objects, masks and the segmented cloud. Without a confident detection on known depth all are empty.

    Raises:
        ValueError: if the arrays do not belong together.
    """
    config = config or LabelConfig()
    _check(rgb, depth_m, intrinsics, camera_to_world, detections)
    usable = [d for d in detections if np.count_nonzero(d.mask) >= config.min_mask_px]
    confident = [d for d in usable if d.confidence >= config.confident]
    sized = confident or (usable if config.agreeing_views else [])
    scale = measure_scale(sized, depth_m, intrinsics, config.max_range_m)
    if scale is None:
        return _empty_labels()
    cloud = build_cloud(
        rgb, depth_m, intrinsics, camera_to_world, voxel_edge_m(scale, config), config.max_range_m, config.max_voxels
    )
    if config.free_space:
        cleared_m = clear_free_space(cloud, Cameras(depth_m, intrinsics, camera_to_world))
        if cleared_m is not depth_m:
            depth_m, voxel_m = cleared_m, cloud.voxel_m
            cloud = build_cloud(
                rgb, depth_m, intrinsics, camera_to_world, voxel_m, config.max_range_m, config.max_voxels
            )
    scene = rgb, depth_m, intrinsics, camera_to_world
    with in_background(
        lambda: build_cloud(*scene, FINE_PX * scale.pixel_m, config.max_range_m, MAX_FINE_POINTS)
    ) as fine:
        find = _associate if config.fuse_views else single_detection_candidates
        candidates = find(cloud, usable, config)
        if not candidates:
            return finalise_labels(_empty_labels(scale), usable, cloud, config)
        if not config.fuse_views:
            views = Views(rgb, intrinsics, camera_to_world, cloud, fine())
            return label_per_detection(views, candidates, scale, config)
        candidates, probability = _segment(cloud, candidates, scale, config)
        objects, kept = _describe_objects(cloud, candidates, probability, config)
        views = Views(rgb, intrinsics, camera_to_world, cloud, fine())
    labels = finalise_labels(_label_views(views, objects, probability[:, kept], scale, config), usable, cloud, config)
    return replace(labels, labels=with_label_defects(labels.labels, config.published))


def _check(rgb, depth_m, intrinsics, camera_to_world, detections) -> None:
    views, size = len(rgb), rgb.shape[1:3]
    if rgb.ndim != 4 or rgb.shape[3] != 3 or views == 0:
        raise ValueError(f"rgb must be (views, height, width, 3) with at least one view, not {rgb.shape}")
    if depth_m.shape != (views, *size):
        raise ValueError(f"depth_m must be {(views, *size)} as rgb is, not {depth_m.shape}")
    if intrinsics.shape != (views, 3, 3) or camera_to_world.shape != (views, 4, 4):
        raise ValueError(
            f"expected {views} intrinsics (3, 3) and poses (4, 4), not {intrinsics.shape} and {camera_to_world.shape}"
        )
    for detection in detections:
        if not 0 <= detection.view_index < views or detection.mask.shape != size:
            raise ValueError(
                f"a detection in view {detection.view_index} with a mask of {detection.mask.shape} does not belong to "
                f"{views} views of {size}"
            )


def _empty_labels(scale: Scale | None = None) -> EpisodeLabels:
    empty = np.zeros((0, 3), np.float32)
    cloud = SegmentedCloud(empty, empty, np.zeros(0, np.int32), np.zeros((0, 0), np.float32))
    return EpisodeLabels((), (), cloud, scale)


def _associate(cloud: Cloud, detections: Sequence[Detection], config: LabelConfig) -> list[Candidate]:
    """Which objects there are, and which detections speak for each."""
    strong: list[DetectionSeeds] = []
    weak: list[DetectionSeeds] = []
    if not (config.weak_evidence or config.agreeing_views):
        detections = [one for one in detections if one.confidence >= config.confident]
    for seeds in in_threads(lambda one: detection_seeds(cloud, one, config), detections):
        if len(seeds.foreground) > 0:
            (strong if seeds.detection.confidence >= config.confident else weak).append(seeds)
    candidates = associate_detections(strong, cloud.num_points, config.merge_overlap)
    unassigned = assign_weak_detections(candidates, weak, cloud.num_points, config.merge_overlap)
    if not config.weak_evidence:
        for candidate in candidates:
            candidate.weak.clear()
    if config.agreeing_views:
        candidates += objects_by_agreement(
            unassigned, cloud.num_points, config.merge_overlap, config.agreeing_views, config.confident
        )
    return candidates


def _segment(
    cloud: Cloud, candidates: list[Candidate], scale: Scale, config: LabelConfig
) -> tuple[list[Candidate], Float32[np.ndarray, "n k"]]:
    """Probability of every object at every point, after objects that turn out to be one have been merged."""
    log_odds = object_log_odds(cloud, candidates, scale.object_m, config)
    near = ActivePoints.of(log_odds > UNREACHABLE_LOG_ODDS)
    kernels = crf_kernels(cloud, near, scale.object_m, config)
    alone = near.marginals(log_odds, kernels, config.iterations, exclusive=False)
    groups = group_segments(candidates, alone, config.merge_overlap)
    if len(groups) < len(candidates):
        merged = []
        for first, *others in groups:
            for other in others:
                for source in candidates[other].sources:
                    candidates[first].add(source)
                candidates[first].weak.extend(candidates[other].weak)
            merged.append(candidates[first])
        candidates = merged
        log_odds = object_log_odds(cloud, candidates, scale.object_m, config)
        near = ActivePoints.of(log_odds > UNREACHABLE_LOG_ODDS)
        kernels = crf_kernels(cloud, near, scale.object_m, config)
        alone = None
    if alone is not None and not config.exclusive:
        return candidates, alone
    return candidates, near.marginals(log_odds, kernels, config.iterations, exclusive=config.exclusive)


def _describe_objects(
    cloud: Cloud, candidates: list[Candidate], probability, config: LabelConfig
) -> tuple[list[LabelledObject], list[int]]:
    """Objects that kept any point, numbered from 1, and their columns; clears strays out of ``probability``."""
    owner = _owner(probability, config.exclusive)
    votes_for = _support(owner, candidates)
    strays = segment_outliers(cloud.points, owner, len(candidates), cloud.voxel_m, config, votes_for)
    probability[strays] = 0
    owner[strays] = -1
    objects, kept = [], []
    for k, candidate in enumerate(candidates):
        members = owner == k
        if not members.any() or (config.consistency and not is_consistent(candidate, config.confident)):
            continue
        sources = sorted(candidate.sources, key=lambda s: (-s.detection.confidence, s.detection.view_index))
        category = candidate.category
        objects.append(
            LabelledObject(
                instance_id=len(objects) + 1,
                category=category,
                confidence=_object_confidence(candidate, category),
                box_3d=fit_box(cloud.points[members], margin_m=BOX_MARGIN_VOXELS * cloud.voxel_m),
                sources=tuple(
                    Source(s.detection.view_index, float(s.detection.confidence), s.detection.category) for s in sources
                ),
            )
        )
        kept.append(k)
    return objects, kept


def _support(owner: Int32[np.ndarray, "n"], candidates: Sequence[Candidate]) -> Float32[np.ndarray, "n"]:
    """Sum of the confidences of the detections of its own object that a point lies in."""
    votes_for = np.zeros(len(owner), np.float32)
    for k, candidate in enumerate(candidates):
        for seeds in (*candidate.sources, *candidate.weak):
            own = seeds.foreground[owner[seeds.foreground] == k]
            votes_for[own] += np.float32(seeds.detection.confidence)
    return votes_for


def _owner(probability: Float32[np.ndarray, "n k"], exclusive: bool) -> Int32[np.ndarray, "n"]:
    """The object a point belongs to, -1 for none: as pixels are decided."""
    return modal_masks(probability[None], np.ones((1, len(probability)), bool), exclusive)[0]


def _object_confidence(candidate: Candidate, category: str) -> float:
    """Mean confidence of the sources, times the share of the votes on the object that its category won."""
    votes = candidate.category_votes()
    mean = float(np.mean([source.detection.confidence for source in candidate.sources]))
    return mean * votes[category] / max(sum(votes.values()), 1e-9)


def _label_views(
    views: Views,
    objects: list[LabelledObject],
    probability: Float32[np.ndarray, "n k"],
    scale: Scale,
    config: LabelConfig,
) -> EpisodeLabels:
    """Masks of all objects in all views."""
    cloud, fine = views.cloud, views.fine
    owner = _owner(probability, config.exclusive)
    voxel_of_fine = cloud.parents_of(fine)
    owner_of_fine = owner[voxel_of_fine]
    reach_px = fill_reach_px(cloud.voxel_m, scale.pixel_m, config)

    def labels_of(view: int) -> list[PseudoLabel]:
        labels = []
        camera = (views.intrinsics[view], views.camera_to_world[view], views.rgb.shape[1:3], fine.voxel_m)
        own = visible_voxels(views, view, voxel_of_fine, config)
        borrowed = None
        if (own < 0).any():
            nearest = nearest_points(fine.points, *camera)
            borrowed = np.where(nearest >= 0, voxel_of_fine[nearest], np.int32(-1))
        chance, known = view_probabilities(views.rgb[view], own, borrowed, probability, reach_px, config.fill_edge)
        modal = modal_masks(chance, known, config.exclusive)
        whole = silhouettes(fine.points, owner_of_fine, len(objects), *camera)
        if config.published.missing_z_buffer:
            modal = paint_in_order(whole)
        for k, one in enumerate(objects):
            visible = modal == k
            amodal = whole[k] | visible
            if not amodal.any():
                continue
            sure = chance[:, :, k][visible] if visible.any() else probability[owner == k, k]
            labels.append(
                PseudoLabel(
                    view_index=view,
                    instance_id=one.instance_id,
                    category=one.category,
                    confidence=float(min(1.0, one.confidence * sure.mean())),
                    modal=visible,
                    amodal=amodal,
                    source_view_index=one.sources[0].view_index,
                    source_confidence=one.sources[0].confidence,
                )
            )
        return labels

    labels = [label for one in in_threads(labels_of, range(len(views.rgb))) for label in one]
    instance_ids = np.array([0, *(one.instance_id for one in objects)], np.int32)[owner + 1]
    segmented = SegmentedCloud(cloud.points, cloud.colours, instance_ids, probability)
    return EpisodeLabels(tuple(objects), tuple(labels), segmented, scale)
