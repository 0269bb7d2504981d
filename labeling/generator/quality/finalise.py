"""The last step of labelling: confidences become expected IoU, regions to ignore are marked, boxes are completed."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from labeling.core.episode_labels import EpisodeLabels, IgnoredRegion, LabelledObject
from labeling.core.types import Box3d, Detection, PseudoLabel
from labeling.generator.cloud.ground import floor_height
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.quality.box_completion import extend_to_support
from labeling.generator.quality.ignore_regions import unconfirmed_regions
from labeling.generator.quality.label_quality import LabelQualityModel, features_of
from labeling.generator.settings.label_config import LabelConfig


def finalise_labels(
    labels: EpisodeLabels,
    detections: Sequence[Detection],
    cloud: Cloud,
    model: LabelQualityModel,
    config: LabelConfig,
) -> EpisodeLabels:
    """The labels with expected IoU as confidence, without those below a threshold, regions to ignore, and boxes that
    are completed.

    Args:
        labels: as segmented; the confidence of a label is its object's, times the mean probability in its mask.
        detections: of all views, confident or not.
        cloud: the points of the views.
        model: of the labels' expected IoU.
        config: settings.
    """
    unconfirmed = None
    if config.ignore_unconfirmed < 1:
        unconfirmed = unconfirmed_regions(cloud, detections, labels.labels, config)
    if config.complete_boxes and labels.objects:
        labels = replace(labels, objects=_with_completed_boxes(labels, cloud.voxel_m))
    # The model knows detectors, not people.
    if config.calibrate and not any(detection.exact for detection in detections):
        labels = _calibrated(labels, detections, model)
    return _without_doubtful(labels, unconfirmed, config)


def _with_completed_boxes(labels: EpisodeLabels, voxel_m: float) -> tuple[LabelledObject, ...]:
    """The objects with boxes that reach down to what they stand on."""
    points, owner = labels.cloud.points, labels.cloud.instance_id
    floor_m = floor_height(points, voxel_m)

    def completed(box: Box3d | None, number: int) -> Box3d | None:
        return None if box is None else extend_to_support(box, points, owner == number, voxel_m, floor_m)

    return tuple(
        replace(
            one,
            box_3d=completed(one.box_3d, one.instance_id),
            places=tuple(replace(place, box_3d=completed(place.box_3d, one.instance_id)) for place in one.places),
        )
        for one in labels.objects
    )


def _calibrated(labels: EpisodeLabels, detections: Sequence[Detection], model: LabelQualityModel) -> EpisodeLabels:
    """The labels with their expected IoU as confidence."""
    categories = [one.category for one in labels.labels]
    expected = model.expected_iou(features_of(labels, detections), categories)
    found = tuple(replace(one, confidence=float(iou)) for one, iou in zip(labels.labels, expected, strict=True))
    return replace(labels, labels=found, objects=tuple(_with_mean_confidence(one, found) for one in labels.objects))


def _with_mean_confidence(one: LabelledObject, labels: Sequence[PseudoLabel]) -> LabelledObject:
    """The object with the mean confidence of its labels, weighted by their visible pixels."""
    own = [label for label in labels if label.instance_id == one.instance_id]
    if not own:
        return one
    sizes = np.array([1e-3 + np.count_nonzero(label.modal) for label in own])
    return replace(one, confidence=float(np.average([label.confidence for label in own], weights=sizes)))


def _without_doubtful(
    labels: EpisodeLabels, unconfirmed: Sequence[IgnoredRegion] | None, config: LabelConfig
) -> EpisodeLabels:
    """The labels without those below ``config.min_confidence``, which are ignored with what is unconfirmed, if that is
    looked for.
    """
    kept = tuple(one for one in labels.labels if one.confidence >= config.min_confidence)
    if unconfirmed is None:
        return replace(labels, labels=kept)
    doubtful = [
        IgnoredRegion(one.view_index, one.category, one.confidence, one.modal, one.instance_id)
        for one in labels.labels
        if one.confidence < config.min_confidence and one.modal.any()
    ]
    ignored = sorted([*doubtful, *unconfirmed], key=lambda region: region.view_index)
    return replace(labels, labels=kept, ignored=tuple(ignored))
