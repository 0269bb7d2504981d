"""Which objects there are, and which detections speak for each."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import (
    Candidate,
    UnsureGroup,
    assign_weak_detections,
    associate_detections,
    group_unsure,
)
from labeling.generator.objects.object_posterior import Looks, ObjectModel, looks_at
from labeling.generator.objects.seeds import DetectionSeeds
from labeling.generator.settings.label_config import LabelConfig


def group_detections(
    seeds: Iterable[DetectionSeeds], num_voxels: int, config: LabelConfig
) -> tuple[list[Candidate], list[UnsureGroup]]:
    """Objects that a view is sure of, with all that speaks for them, and groups of the detections that are left."""
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


def looks_of(
    cloud: Cloud, eyes_m: Float[np.ndarray, "v 3"], sure: Sequence[Candidate], groups: Sequence[UnsureGroup] = ()
) -> list[Looks]:
    """The looks at objects and groups."""
    objects = [(one.detections, one.foreground_voxels) for one in sure]
    objects += [([seeds.detection for seeds in one.seeds], one.foreground_voxels) for one in groups]
    return looks_at(cloud, eyes_m, objects) if objects else []


def find_objects(
    cloud: Cloud,
    eyes_m: Float[np.ndarray, "v 3"],
    seeds: Iterable[DetectionSeeds],
    model: ObjectModel,
    config: LabelConfig,
) -> list[Candidate]:
    """Objects that a view is sure of, and others that all looks together make likely.

    Args:
        cloud: the points of all views.
        eyes_m: where each view was taken from, world.
        seeds: detections in the cloud.
        model: what looks say of objects.
        config: settings.
    """
    sure, groups = group_detections(seeds, cloud.num_points, config)
    likely = [
        one.as_candidate(cloud.num_points)
        for one, looks in zip(groups, looks_of(cloud, eyes_m, [], groups), strict=True)
        if max(model.posterior(looks).values()) >= config.min_posterior
    ]
    return with_posteriors(cloud, eyes_m, [*sure, *likely], model)


def with_posteriors(
    cloud: Cloud,
    eyes_m: Float[np.ndarray, "v 3"],
    candidates: Sequence[Candidate],
    model: ObjectModel,
) -> list[Candidate]:
    """The objects with the chances of their categories; those that a person drew are what the person says."""
    unknown = [
        k
        for k, one in enumerate(candidates)
        if len(one.foreground_voxels) > 0 and not any(seen.exact for seen in one.detections)
    ]
    found = list(candidates)
    for k, looks in zip(unknown, looks_of(cloud, eyes_m, [candidates[k] for k in unknown]), strict=True):
        found[k] = replace(candidates[k], posterior=model.posterior(looks))
    return found
