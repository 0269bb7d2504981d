"""Labels without anything that was fitted to ground truth: what takes the place of calibrations then."""

import numpy as np

from labeling.generator.calibration.detector_calibration import DetectorCalibration, calibration_of
from labeling.generator.objects.object_posterior import FEATURES, ObjectModel
from labeling.generator.settings.label_config import LabelConfig

UNFITTED_OBJECTS = ObjectModel(
    mean=np.zeros(len(FEATURES)),
    scale=np.ones(len(FEATURES)),
    weight=np.array([float(name == "best") for name in FEATURES]),
    intercept=0.0,
    category_bias={},
)
"""The odds of a category are those of the highest confidence in it, as the detector says them."""


def asks_for_nothing_fitted(config: LabelConfig) -> bool:
    """Whether settings leave out what only fitted models can tell: sizes of categories, and the expected IoU of labels.
    What is worth labelling is then not asked of a fitted model, either.
    """
    return not config.class_sizes and not config.calibrate


def calibration_for(detector: str | None, config: LabelConfig) -> DetectorCalibration:
    """The calibration to label with.

    Args:
        detector: whose detections are labelled from, by name.
        config: settings. Where they ask for nothing that was fitted, which objects there are, and of which category,
            is what ``UNFITTED_OBJECTS`` says, and nothing reads the rest.

    Raises:
        UsageError: if the calibration was written by a version with other models.
    """
    found = calibration_of(detector)
    if not asks_for_nothing_fitted(config):
        return found
    return DetectorCalibration(UNFITTED_OBJECTS, found.labels, found.sizes)
