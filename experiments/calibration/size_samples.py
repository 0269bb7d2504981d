"""Sizes of labelled objects, with what detections say of each and what it truly is, to fit the model of sizes."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from experiments.calibration.label_samples import UNCALIBRATED, LabelledGroup, labelled_groups
from labeling.core.masks import mask_iou
from labeling.generator.calibration.detector_calibration import DetectorCalibration
from labeling.generator.objects.object_sizes import measure_sizes

SAME_IOU = 0.3
"""Least overlap of a label with ground truth, of any name, to be of this object."""

SizeSample = tuple[Mapping[str, float], Float[np.ndarray, "5"], str | None]
"""Probability of each category without its size, the size, and the true category; None where there is no object."""


def size_samples(datasets: Sequence[Path], seed: int, calibration: DetectorCalibration) -> list[SizeSample]:
    """Objects of all episodes of some datasets, labelled each alone, and the episodes of each scene together.

    Args:
        datasets: folders of episodes.
        seed: of label generation.
        calibration: of their detector; only what it says of objects counts.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth.
    """
    config = replace(UNCALIBRATED, seed=seed, class_sizes=False)
    return [
        sample
        for together in (False, True)
        for group in labelled_groups(datasets, calibration, config, together)
        for sample in _of_group(group)
    ]


def _of_group(group: LabelledGroup) -> list[SizeSample]:
    truth: dict[int, Counter[str | None]] = defaultdict(Counter)
    for k, label in group.own_labels():
        there = (one for one in group.episodes[k].ground_truth or () if one.view_index == label.view_index)
        overlap, name = max(((mask_iou(label.modal, one.modal), one.category) for one in there), default=(0.0, ""))
        truth[label.instance_id][name if overlap >= SAME_IOU else None] += int(np.count_nonzero(label.modal))
    cloud, objects = group.found.cloud, group.found.objects
    sizes = measure_sizes(cloud.points, cloud.instance_id, [one.instance_id for one in objects])
    return [
        (one.posterior, size, truth[one.instance_id].most_common(1)[0][0])
        for one, size in zip(objects, sizes, strict=True)
        if one.posterior is not None and size is not None and one.instance_id in truth
    ]
