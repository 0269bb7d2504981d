"""Where the masks come from that labels are made of."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from labeling.core.errors import UsageError
from labeling.detectors.registry import check_name


@dataclass(frozen=True)
class SourceConfig:
    """Where the masks come from that labels are made of; by default each episode's ``detections.json``."""

    detections: Path | None = None
    """One COCO JSON with the detections of all episodes: "images" (by file_name), "categories",
    "annotations" with a score; or, for a single episode, a bare list of COCO results."""
    detector: str | None = None
    """Run this detector: ``compact``, ``maskrcnn_resnet50_fpn``, the folder of a labeling.finetune run, ``onnx:FILE``,
    or a Python callable ``package.module:function`` that takes a picture (h, w, 3; uint8; RGB) and returns a list of
    (category, confidence, mask or box). What it finds is kept in the label set, so that it runs once."""
    with_recorded: bool = False
    """Take the detections that were recorded with the episodes as well as what --detector finds; where both have found
    an object in a view, the surer one."""
    weak: Literal["off", "one-view"] = "off"
    """Weak supervision: label from one true mask per object, drawn by a person or, for experiments, taken from
    ``ground_truth.json`` (one view per object, chosen at random by --seed). Source: thesis A.6."""
    annotations: Path | None = None
    """COCO JSON of any annotation tool (polygons or RLE) with those masks; implies ``--weak one-view``."""

    @property
    def is_weak(self) -> bool:
        """Whether a person's masks are the sources."""
        return self.weak != "off" or self.annotations is not None

    @property
    def reads_ground_truth(self) -> bool:
        """Whether the sources are taken from ``ground_truth.json``."""
        return self.is_weak and self.annotations is None

    def check(self) -> None:
        """Refuses settings that contradict each other.

        Raises:
            UsageError: naming the settings.
        """
        given = [
            f"--{name}"
            for name, value in (
                ("detections", self.detections),
                ("detector", self.detector),
                ("annotations" if self.annotations else "weak one-view", self.is_weak or None),
            )
            if value is not None
        ]
        if len(given) > 1:
            raise UsageError(f"{' and '.join(given)} contradict each other; labels have one kind of source")
        if self.with_recorded and self.detector is None:
            raise UsageError(
                "--with-recorded says what to take beside the findings of a detector; give one with --detector"
            )
        for name in ("detections", "annotations"):
            path = getattr(self, name)
            if path is not None and not path.is_file():
                raise UsageError(f"--{name} {path}: no such file")
        if self.detector is not None:
            check_name(self.detector)
