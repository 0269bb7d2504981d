"""The label generator: a few confident detections become masks of every object in every view of an episode.

    from labeling.propagate import propagate
    labels = propagate(rgb, depth_m, intrinsics, camera_to_world, detections)
    labels.labels[0].modal

Source: thesis 4.3 and figure 4.1; what goes beyond it is told in docs/how-it-works.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from labeling.boxes3d import fit_box
from labeling.consistency import is_consistent
from labeling.crf import Kernel, mean_field
from labeling.episode_labels import EpisodeLabels, LabelledObject, SegmentedCloud, Source
from labeling.evidence import Evidence, gather_evidence
from labeling.fusion import object_log_odds
from labeling.instances import Detection, PseudoLabel
from labeling.label_config import LabelConfig
from labeling.lattice import build_lattice
from labeling.masks_2d import modal_masks, view_probabilities
from labeling.merging import Candidate, agreed_objects, attach_weak, group_detections, merge_segments
from labeling.pointcloud import Cloud, build_cloud
from labeling.scale import Scale, measure_scale
from labeling.splatting import nearest_points, silhouettes
from labeling.strays import stray_points

FINE_PX = 2.0
"""Spacing of the points that masks are drawn from, in pixels: as fine as depth sensors sample."""
MAX_FINE_POINTS = 3_000_000
"""Bounds the memory for them."""
STRAY_GAP_VOXELS = 2.0
"""Pieces of a segment closer than this are one piece."""


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
        return _nothing()
    cloud = build_cloud(
        rgb, depth_m, intrinsics, camera_to_world, scale.voxel_m(config), config.max_range_m, config.max_voxels
    )
    candidates = _find_objects(cloud, usable, config)
    if not candidates:
        return _nothing(scale)
    candidates, probability = _segment(cloud, candidates, scale, config)
    objects, kept = _describe(cloud, candidates, probability, config)
    fine = build_cloud(
        rgb, depth_m, intrinsics, camera_to_world, FINE_PX * scale.pixel_m, config.max_range_m, MAX_FINE_POINTS
    )
    views = _Views(rgb, intrinsics, camera_to_world, cloud, fine)
    return _label_views(views, objects, probability[:, kept], scale, config)


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


def _nothing(scale: Scale | None = None) -> EpisodeLabels:
    empty = np.zeros((0, 3), np.float32)
    cloud = SegmentedCloud(empty, empty, np.zeros(0, np.int32), np.zeros((0, 0), np.float32))
    return EpisodeLabels((), (), cloud, scale)


def _find_objects(cloud: Cloud, detections: Sequence[Detection], config: LabelConfig) -> list[Candidate]:
    """Which objects there are, and which detections speak for each."""
    strong: list[Evidence] = []
    weak: list[Evidence] = []
    for detection in detections:
        sure = detection.confidence >= config.confident
        if sure or config.weak_evidence or config.agreeing_views:
            evidence = gather_evidence(cloud, detection, config)
            if len(evidence.foreground) > 0:
                (strong if sure else weak).append(evidence)
    candidates = group_detections(strong, cloud.num_points, config.merge_overlap)
    homeless = attach_weak(candidates, weak, cloud.num_points, config.merge_overlap)
    if not config.weak_evidence:
        for candidate in candidates:
            candidate.weak.clear()
    if config.agreeing_views:
        candidates += agreed_objects(
            homeless, cloud.num_points, config.merge_overlap, config.agreeing_views, config.confident
        )
    return candidates


def _segment(
    cloud: Cloud, candidates: list[Candidate], scale: Scale, config: LabelConfig
) -> tuple[list[Candidate], Float32[np.ndarray, "n k"]]:
    """Probability of every object at every point, after objects that turn out to be one have been merged."""
    log_odds = object_log_odds(cloud, candidates, scale.object_m, config)
    kernels = _kernels(cloud, scale, config)
    alone = mean_field(log_odds, kernels, config.iterations, exclusive=False)
    groups = merge_segments(candidates, alone, config.merge_overlap)
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
        alone = None
    if alone is not None and not config.exclusive:
        return candidates, alone
    return candidates, mean_field(log_odds, kernels, config.iterations, exclusive=config.exclusive)


def _kernels(cloud: Cloud, scale: Scale, config: LabelConfig) -> list[Kernel]:
    """Appearance and smoothness kernels; their lattices serve all objects."""
    width_m = config.appearance_width * scale.object_m
    appearance = np.concatenate([cloud.points / width_m, cloud.colours / config.appearance_colour], axis=1)
    smoothness = cloud.points / (config.smoothness_width_voxels * cloud.voxel_m)
    return [
        Kernel(build_lattice(appearance), config.appearance_weight),
        Kernel(build_lattice(smoothness), config.smoothness_weight),
    ]


def _describe(
    cloud: Cloud, candidates: list[Candidate], probability, config: LabelConfig
) -> tuple[list[LabelledObject], list[int]]:
    """Objects that kept any point, numbered from 1, and their columns; clears strays out of ``probability``."""
    owner = _owner(probability, config.exclusive)
    strays = stray_points(cloud.points, owner, len(candidates), STRAY_GAP_VOXELS * cloud.voxel_m, config.min_piece)
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
                box_3d=fit_box(cloud.points[members], margin_m=cloud.voxel_m),
                sources=tuple(
                    Source(s.detection.view_index, float(s.detection.confidence), s.detection.category) for s in sources
                ),
            )
        )
        kept.append(k)
    return objects, kept


def _owner(probability: Float32[np.ndarray, "n k"], exclusive: bool) -> Int32[np.ndarray, "n"]:
    """The object a point belongs to, -1 for none: as pixels are decided."""
    return modal_masks(probability[None], np.ones((1, len(probability)), bool), exclusive)[0]


def _object_confidence(candidate: Candidate, category: str) -> float:
    """Mean confidence of the sources, times the share of the votes on the object that its category won."""
    votes = candidate.category_votes()
    mean = float(np.mean([source.detection.confidence for source in candidate.sources]))
    return mean * votes[category] / max(sum(votes.values()), 1e-9)


@dataclass(frozen=True)
class _Views:
    """What masks are drawn from."""

    rgb: UInt8[np.ndarray, "views h w 3"]
    intrinsics: Float[np.ndarray, "views 3 3"]
    camera_to_world: Float[np.ndarray, "views 4 4"]
    cloud: Cloud
    fine: Cloud
    """The same points at the resolution of the pictures, so that what is drawn from them has sharp outlines."""

    def voxel_of_fine(self) -> Int32[np.ndarray, "m"]:
        """The voxel that each fine point lies in."""
        voxel = np.full(self.fine.num_points, -1, np.int32)
        own = self.fine.voxel_of_pixel >= 0
        voxel[self.fine.voxel_of_pixel[own]] = self.cloud.voxel_of_pixel[own]
        return voxel


def _label_views(
    views: _Views,
    objects: list[LabelledObject],
    probability: Float32[np.ndarray, "n k"],
    scale: Scale,
    config: LabelConfig,
) -> EpisodeLabels:
    """Masks of all objects in all views."""
    cloud, fine = views.cloud, views.fine
    owner = _owner(probability, config.exclusive)
    voxel_of_fine = views.voxel_of_fine()
    owner_of_fine = owner[voxel_of_fine]
    reach_px = config.fill_px or max(2.0, 0.5 * cloud.voxel_m / scale.pixel_m)
    labels = []
    for view in range(len(views.rgb)):
        camera = (views.intrinsics[view], views.camera_to_world[view], views.rgb.shape[1:3], fine.voxel_m)
        own = cloud.voxel_of_pixel[view]
        borrowed = None
        if (own < 0).any():
            nearest = nearest_points(fine.points, *camera)
            borrowed = np.where(nearest >= 0, voxel_of_fine[nearest], np.int32(-1))
        chance, known = view_probabilities(views.rgb[view], own, borrowed, probability, reach_px, config.fill_edge)
        modal = modal_masks(chance, known, config.exclusive)
        whole = silhouettes(fine.points, owner_of_fine, len(objects), *camera)
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
    instance_ids = np.array([0, *(one.instance_id for one in objects)], np.int32)[owner + 1]
    segmented = SegmentedCloud(cloud.points, cloud.colours, instance_ids, probability)
    return EpisodeLabels(tuple(objects), tuple(labels), segmented, scale)
