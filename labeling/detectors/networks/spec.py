"""What a network is, apart from its weights: architecture, classes, input size, and how its scores are calibrated."""

import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any

import msgspec

from labeling.core.detector import DetectorError

FORMAT = 1
ARCHITECTURES = ("compact", "maskrcnn_resnet50_fpn")
PREDICTED_MASK_THRESHOLD = 0.4
"""From this probability on a pixel is part of a predicted mask. At .5 masks are as large as things are, but lack their
ends, of which no pixel is likely enough: boxes around masks are too small. Chosen on homes and towns of the endless
split (docs/design-notes.md). Source: Lipton et al. 2014, "Optimal Thresholding of Classifiers to Maximize F1
Measure"."""


@dataclass(frozen=True)
class Calibration:
    """Turns scores into confidences that mean what they say: ``sigmoid(logit(score) / temperature + bias)``.

    It is monotone for every class alike, so that rankings, and with them average precision, stay as they are.
    Source: Platt 1999; with bias 0 Guo et al. 2017.
    """

    temperature: float = 1.0
    """Above 0; more than 1 makes scores more modest."""
    bias: float = 0.0
    """Nats; less than 0 makes scores more modest."""


@dataclass(frozen=True)
class NetworkSpec:
    """Everything that is needed to build a network before its weights are read; stored beside them."""

    architecture: str
    categories: tuple[str, ...]
    """Names of the outputs 1, 2, ... of the classifier (0 is the background). An empty name is an output that is never
    reported."""
    short_side_px: tuple[int, int] = (128, 320)
    """Pictures whose shorter side lies outside are resized to the nearer end."""
    long_side_px: int = 1344
    """Then pictures whose longer side exceeds this are reduced."""
    calibration: Calibration = field(default_factory=Calibration)
    about: dict[str, Any] = field(default_factory=dict)
    """Where the weights come from: data, seed, versions. For people; nothing depends on it."""

    @property
    def names(self) -> tuple[str, ...]:
        """The categories that are reported."""
        return tuple(name for name in self.categories if name)

    def input_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """Height and width in pixels to which a picture of this height and width is resized."""
        short, long = min(size), max(size)
        scale = min(max(short, self.short_side_px[0]), self.short_side_px[1]) / short
        scale = min(scale, self.long_side_px / long)
        return max(1, round(size[0] * scale)), max(1, round(size[1] * scale))

    def as_json(self) -> str:
        """The spec as text; ``from_json`` reads it."""
        return json.dumps({"format": FORMAT, **asdict(self)})

    @classmethod
    def from_json(cls, text: str, where: str) -> "NetworkSpec":
        """Reads and checks a spec.

        Args:
            text: what ``as_json`` returned.
            where: names the file in messages.

        Raises:
            DetectorError: if it is malformed, or of a newer format.
        """
        try:
            content = json.loads(text)
            if content.pop("format") != FORMAT:
                raise ValueError("written by another version of this program")
            spec = msgspec.convert(content, cls)
            spec.check()
        except (ValueError, KeyError, TypeError, AttributeError, msgspec.ValidationError) as error:
            raise DetectorError(
                f"{where}: does not say what network it holds ({type(error).__name__}: {error})"
            ) from None
        return spec

    def check(self) -> None:
        """Refuses what cannot be built.

        Raises:
            ValueError: saying what is wrong.
        """
        if self.architecture not in ARCHITECTURES:
            raise ValueError(f"unknown architecture {self.architecture!r}; known: {', '.join(ARCHITECTURES)}")
        if not self.names:
            raise ValueError("a detector needs at least one category")
        twice = sorted({name for name in self.names if self.names.count(name) > 1})
        if twice:
            raise ValueError(f"categories are listed twice: {', '.join(twice)}")
        if not 0 < self.short_side_px[0] <= self.short_side_px[1] <= self.long_side_px:
            raise ValueError("input sizes must rise: short_side_px[0] <= short_side_px[1] <= long_side_px")
        if not (self.calibration.temperature > 0 and math.isfinite(self.calibration.bias)):
            raise ValueError("a calibration needs a temperature above 0 and a finite bias")
