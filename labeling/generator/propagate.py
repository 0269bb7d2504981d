"""The label generator: a few confident detections become masks of every object in every view of an episode.

    from labeling import RgbdViews, propagate
    labels = propagate(RgbdViews(rgb, depth_m, intrinsics, camera_to_world), detections)
    labels.labels[0].modal

Source: thesis 4.3 and figure 4.1; what goes beyond it is told in docs/how-it-works.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64

from labeling.core.boxes3d import fit_box
from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Scale, SegmentedCloud, Source
from labeling.core.pose_check import PoseCheck
from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.calibration.detector_calibration import DetectorCalibration, calibration_of
from labeling.generator.cloud.free_space import clear_free_space
from labeling.generator.cloud.ground import find_ground, ground_of_objects
from labeling.generator.cloud.moved import moved_detections, moved_voxels
from labeling.generator.cloud.object_scale import measure_scale, voxel_edge_m
from labeling.generator.cloud.outliers import segment_outliers
from labeling.generator.cloud.voxel_cloud import Cloud, build_cloud
from labeling.generator.draw.fused_views import FusedViews
from labeling.generator.draw.joined_tracks import join_tracks
from labeling.generator.draw.object_masks import draw_labels
from labeling.generator.draw.view_masks import point_owners
from labeling.generator.near_origin import moved_labels, moved_views, offset_of
from labeling.generator.objects.association import Candidate, group_segments, is_consistent
from labeling.generator.objects.candidate_sizes import with_sizes
from labeling.generator.objects.find_objects import find_objects, with_posteriors
from labeling.generator.objects.nested_masks import without_nested
from labeling.generator.objects.seeds import DetectionSeeds, detection_trimap, trimap_seeds
from labeling.generator.objects.tracks import with_shared_posteriors, without_settled
from labeling.generator.poses.agreement import with_agreeing_poses
from labeling.generator.quality.finalise import finalise_labels
from labeling.generator.segment.crf import ObjectCrf
from labeling.generator.segment.end_boards import complete_end_boards
from labeling.generator.segment.level_surfaces import complete_level_surfaces
from labeling.generator.segment.thin_parts import ThinParts, find_thin_parts
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import with_label_defects
from labeling.generator.thesis.per_detection import label_per_detection, single_detection_candidates
from labeling.runtime.memory import trim_memory
from labeling.runtime.progress import report_progress
from labeling.runtime.threads import in_background

BOX_TRIM, BOX_MARGIN_VOXELS = 0.003, 0.75
"""Of 3-D boxes: the share of points that may stick out on each side, chosen in training scenes (more would leave out
handlebars, mirrors and leaves); and what is added to the sides, since points are means over voxels."""

ADDED_PROBABILITY = np.float32(0.95)
"""Of an object at the points that its level surfaces and the boards at its ends lacked."""

MANY_PX = 4_000_000
"""With more pixels in all views memory is given back in between."""


def propagate(
    views: RgbdViews,
    detections: Sequence[Detection] | None,
    config: LabelConfig | None = None,
    calibration: DetectorCalibration | None = None,
) -> EpisodeLabels:
    """Labels every view of an episode from its confident detections.

    Args:
        views: of one scene; an ``Episode`` is one, too.
        detections: of all views, confident or not, with masks of the views' size; None is as good as none.
        config: settings; the defaults if None.
        calibration: what the detections are worth; None takes them to be like those of most detectors.

    Returns:
        Objects, masks and the segmented cloud. Without a confident detection on known depth all are empty.

    Raises:
        TypeError: if pictures are not uint8, depth is not float32, or a mask is not bool.
        ValueError: if intrinsics or poses are not finite, a detection does not belong to the views, or its confidence
            is not in [0, 1].

    Example:
        >>> views = RgbdViews(
        ...     rgb=np.zeros((1, 48, 64, 3), np.uint8),
        ...     depth_m=np.full((1, 48, 64), 2.0, np.float32),
        ...     intrinsics=np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])[None],
        ...     camera_to_world=np.eye(4)[None],
        ... )
        >>> poster = np.zeros((48, 64), bool)
        >>> poster[12:36, 20:44] = True
        >>> labels = propagate(views, [Detection(0, "poster", 0.95, poster)])
        >>> [one.category for one in labels.objects], len(labels.cloud.points) > 0
        (['poster'], True)
    """
    config, detections = config or LabelConfig(), detections or ()
    _check_views(views)
    _check_detections(detections, views)
    usable = [one for one in detections if np.count_nonzero(one.mask) >= config.min_mask_px]
    calibration = calibration or calibration_of()
    offset_m = offset_of(views)
    if offset_m.any():
        return moved_labels(propagate(moved_views(views, -offset_m), detections, config, calibration), offset_m)
    scene = fuse_scene(views, usable, config)
    if scene is None:
        return _empty_labels()
    return replace(_label(scene, usable, calibration, config), poses=scene.poses)


def _label(
    scene: "FusedScene", usable: Sequence[Detection], calibration: DetectorCalibration, config: LabelConfig
) -> EpisodeLabels:
    """Labels the views of a fused scene.

    Args:
        scene: views, cloud and seeds.
        usable: detections of these views with large enough masks.
        calibration: of their detector.
        config: settings.
    """
    views, cloud, scale = scene.views, scene.cloud, scene.scale
    if config.fuse_views:
        candidates = find_objects(cloud, scene.eyes_m, scene.seeds, calibration.objects, config, scene.moved)
    else:
        candidates = single_detection_candidates(cloud, usable, config)
    if not candidates:
        return finalise_labels(_empty_labels(scale), usable, cloud, calibration.labels, config)
    if not config.fuse_views:
        return label_per_detection(views, cloud, candidates, scale, config)
    known = len(candidates)
    report_progress(f"segmenting {known} objects in {cloud.num_points} voxels")
    candidates, probability = _segment(cloud, candidates, scale, config)
    if len(candidates) < known:
        candidates = with_posteriors(cloud, scene.eyes_m, candidates, calibration.objects, scene.moved)
    if scene.moved is not None:
        probability = without_settled(cloud, candidates, probability, scene.moved)
    claimed = point_owners(probability, config.exclusive)
    inside, owner = claimed >= 0, _without_outliers(cloud, claimed, candidates, config)
    ground = None
    if config.clear_ground or config.level_surfaces or config.end_boards or config.thin_parts:
        ground = find_ground(cloud, views, owner < 0, scale.object_m)
    if ground is not None and config.clear_ground:
        # Before outliers are told: ground holds together what lies apart, and may be more than all of an object.
        inside &= ~ground_of_objects(cloud, claimed, len(candidates), ground)
        owner = _without_outliers(cloud, np.where(inside, claimed, np.int32(-1)), candidates, config)
    removed = (claimed >= 0) & (owner < 0)
    beside = {k: one.beside_outlines for k, one in enumerate(candidates) if one.outlined_in}
    completions = (config.level_surfaces, complete_level_surfaces), (config.end_boards, complete_end_boards)
    for wanted, complete in completions:
        if ground is not None and wanted:
            free = np.where(removed, np.int32(-2), owner)
            more = complete(cloud, free, len(candidates), ground, beside)
            probability = _with_added(probability, more)
            owner, inside = np.where(more >= 0, more, owner), inside | (more >= 0)
    parts = None
    if ground is not None and config.thin_parts:
        parts = find_thin_parts(cloud, views, owner, len(candidates), ground, scale.object_m, beside)
        inside |= parts.owner >= 0
    if config.class_sizes:
        whole = owner if parts is None else np.where(parts.owner >= 0, parts.owner, owner)
        candidates = with_shared_posteriors(with_sizes(cloud, candidates, whole, calibration.sizes))
    report_progress(f"drawing masks into {views.num_views} views")
    with in_background(lambda: FusedViews.of(views, cloud, inside, scale.pixel_m, config)) as fused:
        objects, columns = _describe_objects(cloud, candidates, owner, parts, config)
        probability = np.where(removed[:, None], np.float32(0), probability[:, columns])
        parts = parts and parts.of_objects(columns)
        tracks = [candidates[k].track for k in columns]
        moves = np.array([track is not None for track in tracks], bool)
        drawn = join_tracks(draw_labels(fused(), objects, probability, parts, scale, config, moves), tracks)
    if views.depth_m.size > MANY_PX:  # what is not needed any more makes room for regions to ignore, which need much
        del fused, candidates
        scene.seeds.clear()
        trim_memory()
    labels = finalise_labels(drawn, usable, cloud, calibration.labels, config)
    return replace(labels, labels=with_label_defects(labels.labels, config.published))


@dataclass(frozen=True)
class FusedScene:
    """The views of an episode fused into one cloud, and the seeds that detections give its voxels."""

    views: RgbdViews
    """With refined poses where these are better (``poses``), and without depth that lies in free space."""
    cloud: Cloud
    scale: Scale
    poses: PoseCheck | None
    seeds: list[DetectionSeeds]
    """Empty unless ``config.fuse_views``; many of them are dropped once labels are drawn."""
    moved: Bool[np.ndarray, "n"] | None = None
    """Voxels that have moved, if any have."""

    @property
    def eyes_m(self) -> Float64[np.ndarray, "v 3"]:
        """Camera positions, metres, world."""
        return np.asarray(self.views.camera_to_world, np.float64)[:, :3, 3]


def fuse_scene(views: RgbdViews, detections: Sequence[Detection], config: LabelConfig) -> FusedScene | None:
    """Fuses views into one cloud and turns detections into seeds of its voxels.

    Args:
        views: of one scene.
        detections: of all views.
        config: settings.

    Returns:
        None if there is no detection to label from on known depth.
    """
    confident = [one for one in detections if one.confidence >= config.confident]
    unsure_too = config.min_posterior < 1
    scale = measure_scale(confident, views, config.max_range_m)
    if scale is None and unsure_too:
        scale = measure_scale(detections, views, config.max_range_m)
    if scale is None:
        return None
    report_progress(f"comparing the poses of {views.num_views} views")
    views, poses = with_agreeing_poses(views, voxel_edge_m(scale, config), config)
    report_progress(f"fusing {views.num_views} views")
    used = detections if config.weak_evidence or unsure_too else confident
    with in_background(lambda: [detection_trimap(one, config) for one in used if config.fuse_views]) as trimaps:
        cloud = build_cloud(views, voxel_edge_m(scale, config), config.max_range_m, config.max_voxels)
        passing = moved_detections(cloud, views, used) if config.moving and config.fuse_views else {}
        if config.free_space:
            cleared = clear_free_space(cloud, views, passing)
            if cleared is not views:
                views = cleared
                cloud = build_cloud(views, cloud.voxel_m, config.max_range_m, config.max_voxels)
        moved = moved_voxels(cloud, views) if passing else None
        # One after the other: many short jobs on several threads cost more than they save. Without ``fuse_views``
        # there are no trimaps, so no seeds either.
        pairs = zip(used, trimaps(), strict=False)
        ground = None
        if config.clear_ground and config.fuse_views and cloud.num_points:
            ground = find_ground(cloud, views, np.ones(cloud.num_points, bool), scale.object_m)
        seeds = [
            trimap_seeds(cloud, one, trimap, config, views.camera(one.view_index), moved, ground)
            for one, trimap in pairs
        ]
    if config.nested_masks:
        seeds = without_nested(seeds, cloud.num_points, config.confident, config.merge_overlap)
    return FusedScene(views, cloud, scale, poses, seeds, moved)


def _check_views(views: RgbdViews) -> None:
    if views.rgb.dtype != np.uint8 or views.depth_m.dtype != np.float32:
        raise TypeError(
            f"rgb must be uint8 and depth_m float32, in metres, not {views.rgb.dtype} and {views.depth_m.dtype}"
        )
    for name, given in (("intrinsics", views.intrinsics), ("camera_to_world", views.camera_to_world)):
        known = np.isfinite(given).all(axis=(1, 2))
        if not known.all():
            raise ValueError(f"{name} of view {int(np.argmin(known))} must be finite: leave out views without a pose")


def _check_detections(detections: Sequence[Detection], views: RgbdViews) -> None:
    for one in detections:
        if not 0 <= one.view_index < views.num_views or one.mask.shape != views.size:
            raise ValueError(
                f"a detection in view {one.view_index} with a mask of {one.mask.shape} does not belong to "
                f"{views.num_views} views of {views.size}"
            )
        if one.mask.dtype != bool:
            raise TypeError(f"the mask of a detection must be bool, not {one.mask.dtype}: compare it with a threshold")
        if not 0 <= one.confidence <= 1:
            raise ValueError(f"the confidence of a detection must be in [0, 1], not {one.confidence}")


def _empty_labels(scale: Scale | None = None) -> EpisodeLabels:
    empty = np.zeros((0, 3), np.float32)
    cloud = SegmentedCloud(empty, empty, np.zeros(0, np.int32), np.zeros((0, 0), np.float32))
    return EpisodeLabels((), (), cloud, scale)


def _segment(
    cloud: Cloud, candidates: list[Candidate], scale: Scale, config: LabelConfig
) -> tuple[list[Candidate], Float32[np.ndarray, "n k"]]:
    """Probability of every object at every point, after objects whose segments overlap have been merged."""
    crf = ObjectCrf.of(cloud, candidates, scale, config)
    binary = crf.marginals(exclusive=False)
    groups = group_segments(candidates, binary, config.merge_overlap)
    if len(groups) == len(candidates) and not config.exclusive:
        return candidates, binary
    if len(groups) < len(candidates):
        candidates = [candidates[first].merged(candidates[k] for k in others) for first, *others in groups]
        crf = crf.merged(groups, cloud, candidates, scale, config)
    return candidates, crf.marginals(config.exclusive)


def _describe_objects(
    cloud: Cloud,
    candidates: Sequence[Candidate],
    owner: Int32[np.ndarray, "n"],
    parts: ThinParts | None,
    config: LabelConfig,
) -> tuple[list[LabelledObject], Int64[np.ndarray, "o"]]:
    """Objects that have any point, numbered from 1, and which of the candidates each of them is."""
    objects, kept = [], []
    for k, candidate in enumerate(candidates):
        members = owner == k
        if not members.any() or (config.consistency and not is_consistent(candidate, config.confident)):
            continue
        if parts is not None:
            members |= parts.owner == k
        sources = sorted(
            (seeds.detection for seeds in candidate.sources), key=lambda one: (-one.confidence, one.view_index)
        )
        category = candidate.category
        objects.append(
            LabelledObject(
                instance_id=len(objects) + 1,
                category=category,
                confidence=_object_confidence(candidate, category),
                box_3d=fit_box(cloud.points[members], BOX_TRIM, BOX_MARGIN_VOXELS * cloud.voxel_m),
                sources=tuple(Source(one.view_index, float(one.confidence), one.category) for one in sources),
                posterior=candidate.posterior,
            )
        )
        kept.append(k)
    return objects, np.array(kept, np.int64)


def _with_added(probability: Float32[np.ndarray, "n k"], added: Int32[np.ndarray, "n"]) -> Float32[np.ndarray, "n k"]:
    """The probabilities after some points have been added to objects (-1 for none)."""
    points = np.flatnonzero(added >= 0)
    if len(points) == 0:
        return probability
    probability = probability.copy()
    probability[points] *= 1 - ADDED_PROBABILITY
    probability[points, added[points]] = ADDED_PROBABILITY
    return probability


def _without_outliers(
    cloud: Cloud, owner: Int32[np.ndarray, "n"], candidates: Sequence[Candidate], config: LabelConfig
) -> Int32[np.ndarray, "n"]:
    """The owners of points without the outliers of their segments."""
    votes = _detection_votes(owner, candidates)
    outliers = segment_outliers(cloud.points, owner, len(candidates), cloud.voxel_m, config, votes)
    return np.where(outliers, np.int32(-1), owner)


def _detection_votes(owner: Int32[np.ndarray, "n"], candidates: Sequence[Candidate]) -> Float32[np.ndarray, "n"]:
    """Sum of the confidences of the detections of its own object that a point lies in."""
    votes = np.zeros(len(owner), np.float32)
    for k, candidate in enumerate(candidates):
        for seeds in (*candidate.sources, *candidate.weak):
            own = seeds.foreground[owner[seeds.foreground] == k]
            votes[own] += np.float32(seeds.detection.confidence)
    return votes


def _object_confidence(candidate: Candidate, category: str) -> float:
    """The chance that it is one of its category; of what a person drew, from confidence and agreement."""
    if candidate.posterior is not None:
        return candidate.posterior[category]
    votes = candidate.category_votes()
    mean = float(np.mean([seeds.detection.confidence for seeds in candidate.sources]))
    return mean * votes[category] / max(sum(votes.values()), 1e-9)
