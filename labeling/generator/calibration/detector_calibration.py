"""What the detections of a detector are worth: one file for each detector that has been calibrated.

They are written by ``python -m experiments.calibrate_labels``.
"""

import re
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from labeling.generator.objects.object_posterior import ObjectModel
from labeling.generator.quality.label_quality import LabelQualityModel

FOLDER = Path(__file__).parent
DEFAULT = "compact"
"""What is not calibrated is taken to be like this detector, without its biases for categories."""


@dataclass(frozen=True)
class DetectorCalibration:
    """What the detections of a detector are worth."""

    objects: ObjectModel
    labels: LabelQualityModel

    def as_json(self) -> dict[str, Any]:
        """As the file has it."""
        return msgspec.to_builtins(asdict(self), enc_hook=lambda value: np.round(value, 6).tolist())


def file_name(detector: str) -> str:
    """What the file of a detector is called, whose name may be a path."""
    return re.sub(r"[^\w.-]", "_", detector) + ".json"


def is_calibrated(detector: str | None) -> bool:
    """Whether there is a file for a detector."""
    return detector is not None and (FOLDER / file_name(detector)).is_file()


@cache
def calibration_of(detector: str | None = None) -> DetectorCalibration:
    """The calibration of a detector by its name; that of ``DEFAULT``, without biases, for others."""
    known = is_calibrated(detector)
    content = msgspec.json.decode((FOLDER / file_name(detector if detector and known else DEFAULT)).read_bytes())
    objects, labels = _with_arrays(content["objects"]), _with_arrays(content["labels"])
    found = DetectorCalibration(ObjectModel(**objects), LabelQualityModel(**labels))
    return found if known else replace(found, objects=replace(found.objects, category_bias={}))


def _with_arrays(content: dict[str, Any]) -> dict[str, Any]:
    return {name: np.array(value) if isinstance(value, list) else value for name, value in content.items()}
