"""Finding objects: from seeds of detections to candidates with probabilities of their categories."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import (
    Candidate,
    UnsureGroup,
    assign_weak_detections,
    associate_detections,
    group_unsure,
)
from labeling.generator.objects.object_posterior import ObjectModel, PlaceObservations, observe_places
from labeling.generator.objects.seeds import DetectionSeeds
from labeling.generator.objects.tracks import has_moved, track_observations, with_tracks
from labeling.generator.settings.label_config import LabelConfig


def group_detections(
    seeds: Iterable[DetectionSeeds], num_voxels: int, config: LabelConfig
) -> tuple[list[Candidate], list[UnsureGroup]]:
    """Groups detections by object.

    Args:
        seeds: detections in the cloud.
        num_voxels: size of the cloud.
        config: settings.

    Returns:
        Candidates with at least one confident detection, and groups of the unsure detections that overlap none of them
        (none with ``min_posterior`` 1).
    """
    confident: list[DetectionSeeds] = []
    weak: list[DetectionSeeds] = []
    for one in seeds:
        if len(one.foreground) > 0:
            (confident if one.detection.confidence >= config.confident else weak).append(one)
    space = num_voxels, config.merge_overlap
    sure = associate_detections(confident, *space)
    assigned, unassigned = assign_weak_detections(sure, weak, config.merge_overlap)
    groups = group_unsure(unassigned, *space) if config.min_posterior < 1 else []
    return assigned if config.weak_evidence else sure, groups


def observations_of(
    cloud: Cloud, eyes_m: Float[np.ndarray, "v 3"], sure: Sequence[Candidate], groups: Sequence[UnsureGroup] = ()
) -> list[PlaceObservations]:
    """What all views observe at the places of candidates, then of groups."""
    objects = [(one.detections, one.foreground_voxels) for one in sure]
    objects += [([seeds.detection for seeds in one.seeds], one.foreground_voxels) for one in groups]
    return observe_places(cloud, eyes_m, objects) if objects else []


def find_objects(
    cloud: Cloud,
    eyes_m: Float[np.ndarray, "v 3"],
    seeds: Iterable[DetectionSeeds],
    model: ObjectModel,
    config: LabelConfig,
    moved: Bool[np.ndarray, "n"] | None = None,
) -> list[Candidate]:
    """Candidates with a confident detection, and others that all views together make likely.

    Args:
        cloud: the points of all views.
        eyes_m: camera positions, metres, world.
        seeds: detections in the cloud.
        model: gives the probability of each category from observations.
        config: settings.
        moved: voxels that have moved, if any have.
    """
    sure, groups = group_detections(seeds, cloud.num_points, config)
    likely = [
        one.as_candidate(cloud.num_points)
        for one, seen in zip(groups, observations_of(cloud, eyes_m, [], groups), strict=True)
        if max(model.posterior(seen).values()) >= config.min_posterior
        or (moved is not None and has_moved(one.foreground_voxels, moved))
    ]
    found = with_posteriors(cloud, eyes_m, [*sure, *likely], model, moved)
    # Of what has moved only all of its places together tell whether it is likely.
    return [
        one
        for k, one in enumerate(found)
        if k < len(sure) or max((one.posterior or {}).values(), default=0.0) >= config.min_posterior
    ]


def with_posteriors(
    cloud: Cloud,
    eyes_m: Float[np.ndarray, "v 3"],
    candidates: Sequence[Candidate],
    model: ObjectModel,
    moved: Bool[np.ndarray, "n"] | None = None,
) -> list[Candidate]:
    """Candidates with the posterior of their categories; those that a person outlined keep the category given.

    Args:
        cloud: the points of all views.
        eyes_m: camera positions, metres, world.
        candidates: objects, or the places in which an object has been.
        model: gives the probability of each category from observations.
        moved: voxels that have moved, if any have; candidates then get tracks, and those of a track one posterior.
    """
    if moved is not None:
        candidates = with_tracks(cloud, candidates, moved)
    unknown = [
        k
        for k, one in enumerate(candidates)
        if len(one.foreground_voxels) > 0 and not any(detection.exact for detection in one.detections)
    ]
    found = list(candidates)
    observed = observations_of(cloud, eyes_m, [candidates[k] for k in unknown])
    if moved is not None:
        observed = track_observations(observed, [candidates[k].track for k in unknown])
    for k, seen in zip(unknown, observed, strict=True):
        found[k] = replace(candidates[k], posterior=model.posterior(seen))
    return found
