"""Calibration of detectors: one JSON file for each detector that has been calibrated.

The files are written by ``python -m experiments.calibrate_labels``.
"""

import re
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from labeling.core.errors import UsageError
from labeling.generator.objects.object_posterior import ObjectModel
from labeling.generator.objects.object_sizes import SizeModel
from labeling.generator.quality.label_quality import LabelQualityModel

FOLDER = Path(__file__).parent
DEFAULT = "compact"
"""Detectors without a file get the calibration of this one, without what it says of single categories."""


@dataclass(frozen=True)
class DetectorCalibration:
    """Models that turn a detector's confidences into probabilities, fitted to ground truth of training episodes."""

    objects: ObjectModel
    labels: LabelQualityModel
    sizes: SizeModel

    def as_json(self) -> dict[str, Any]:
        """The content of the file."""
        return msgspec.to_builtins(asdict(self), enc_hook=lambda value: np.round(value, 6).tolist())


def file_name(detector: str) -> str:
    """Name of the file of a detector; the detector's own name may be a path."""
    return re.sub(r"[^\w.-]", "_", detector) + ".json"


def is_calibrated(detector: str | None) -> bool:
    """Whether there is a file for a detector."""
    return detector is not None and (FOLDER / file_name(detector)).is_file()


@cache
def calibration_of(detector: str | None = None) -> DetectorCalibration:
    """The calibration of a detector by its name; that of ``DEFAULT``, without what is of categories, for others.

    Raises:
        UsageError: if its file was written by a version with other models.
    """
    known = is_calibrated(detector)
    file = FOLDER / file_name(detector if detector and known else DEFAULT)
    try:
        content = msgspec.json.decode(file.read_bytes())
        parts = {name: _with_arrays(content[name]) for name in ("objects", "labels", "sizes")}
        found = DetectorCalibration(
            ObjectModel(**parts["objects"]), LabelQualityModel(**parts["labels"]), SizeModel(**parts["sizes"])
        )
        if not np.all(np.diff(found.labels.knots, axis=1) > 0):
            raise ValueError("knots of label quality do not ascend")
    except (msgspec.DecodeError, KeyError, TypeError, ValueError):
        raise UsageError(
            f"{file}: holds no calibration of this version; make it anew: python -m experiments.calibrate_labels"
        ) from None
    if known:
        return found
    objects, labels = replace(found.objects, category_bias={}), replace(found.labels, lines={})
    return replace(found, objects=objects, labels=labels)


def _with_arrays(content: dict[str, Any]) -> dict[str, Any]:
    """The content with arrays in place of lists, at any depth."""
    return {
        name: _with_arrays(value) if isinstance(value, dict) else np.array(value) if isinstance(value, list) else value
        for name, value in content.items()
    }
