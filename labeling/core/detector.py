"""What a detector is: pictures in; boxes, masks, names and scores out."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from labeling.core.episode import Episode
from labeling.core.errors import SbmError
from labeling.core.masks import box_xyxy
from labeling.core.types import Detection


class DetectorError(SbmError):
    """A detector failed, its files are damaged, or it returned something else than detections.

    Example:
        >>> from labeling.core.errors import SbmError
        >>> issubclass(DetectorError, SbmError)
        True
    """


@dataclass(frozen=True)
class PictureDetections:
    """What a detector says about one picture, the most confident first."""

    categories: tuple[str, ...]
    scores: Float32[np.ndarray, "n"]
    """In [0, 1]."""
    boxes_xyxy: Float32[np.ndarray, "n 4"]
    """Left, top, right, bottom in pixels, the left edge of the picture at 0."""
    masks: Bool[np.ndarray, "n h w"]

    def as_detections(self, view_index: int) -> tuple[Detection, ...]:
        """The same as records of one view; detections without a pixel are left out."""
        return tuple(
            Detection(view_index, category, float(score), mask)
            for category, score, mask in zip(self.categories, self.scores, self.masks, strict=True)
            if mask.any()
        )


class Detector(Protocol):
    """Anything that finds objects in pictures. ``labeling.detectors.registry.load_detector`` makes one from a name."""

    @property
    def name(self) -> str:
        """What it was asked for by."""
        ...

    @property
    def categories(self) -> tuple[str, ...] | None:
        """Every name it can report; None if it does not say."""
        ...

    @property
    def batch_size(self) -> int:
        """How many pictures at a time suit it."""
        ...

    @property
    def digest(self) -> str:
        """Changes with whatever its findings depend on: weights, settings, code."""
        ...

    def detect(
        self, rgb: UInt8[np.ndarray, "b h w 3"], depth_m: Float32[np.ndarray, "b h w"] | None = None
    ) -> list[PictureDetections]:
        """Finds objects.

        Args:
            rgb: pictures of one size.
            depth_m: their z-depth in metres, 0 = no return, where known; only detectors that give boxes but no masks
                use it.

        Returns:
            One entry for each picture.

        Raises:
            DetectorError: if it fails.
        """
        ...


def stack_detections(
    found: Sequence[tuple[str, float, Bool[np.ndarray, "h w"]]], size: tuple[int, int]
) -> PictureDetections:
    """Puts (category, score, mask) together, the most confident first; boxes are the tightest around the masks."""
    ranked = sorted(found, key=lambda one: -one[1])
    masks = np.stack([mask for _, _, mask in ranked]) if ranked else np.zeros((0, *size), bool)
    return PictureDetections(
        categories=tuple(category for category, _, _ in ranked),
        scores=np.array([score for _, score, _ in ranked], np.float32),
        boxes_xyxy=np.array([box_xyxy(mask) for mask in masks], np.float32).reshape(-1, 4),
        masks=masks,
    )


def run_detector(detector: Detector, episode: Episode) -> tuple[Detection, ...]:
    """Looks at every view.

    Args:
        detector: any.
        episode: the views.

    Raises:
        DetectorError: naming the view, if the detector fails or returns something else than detections.
    """
    detections: list[Detection] = []
    size = detector.batch_size
    for start in range(0, episode.num_views, size):
        views = range(start, min(start + size, episode.num_views))
        try:
            found = detector.detect(episode.rgb[start : views.stop], episode.depth_m[start : views.stop])
        except DetectorError as error:
            names = episode.file_names[start]
            if len(views) > 1:
                names += f" to {episode.file_names[views[-1]]}"
            raise DetectorError(f"detector {detector.name} on {names} of {episode.name}: {error}") from error
        for view, one in zip(views, found, strict=True):
            detections.extend(one.as_detections(view))
    return tuple(detections)
