"""What a detector is: pictures in; boxes, masks, names and scores out."""

from collections.abc import Callable, Mapping, Sequence
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
    made_here: tuple[int, ...] = ()
    """Which masks no detector gave: made from their boxes (``labeling.core.box_masks``)."""

    def as_detections(self, view_index: int) -> tuple[Detection, ...]:
        """The same as records of one view; detections without a pixel are left out."""
        found = zip(self.categories, self.scores, self.masks, self.boxes_xyxy.tolist(), strict=True)
        return tuple(
            Detection(view_index, category, float(score), mask, box_xyxy=tuple(box) if i in self.made_here else None)
            for i, (category, score, mask, box) in enumerate(found)
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
            depth_m: their z-depth in metres, 0 = no return, where known; what gives boxes but no masks uses it, and
                functions that ask for it.

        Returns:
            One entry for each picture.

        Raises:
            DetectorError: if it fails.
        """
        ...


def stack_detections(
    found: Sequence[tuple[str, float, Bool[np.ndarray, "h w"]]],
    size: tuple[int, int],
    boxes_xyxy: Mapping[int, Float32[np.ndarray, "4"]] | None = None,
) -> PictureDetections:
    """Puts detections together, the most confident first.

    Args:
        found: category, score and mask of each.
        size: height and width of the picture.
        boxes_xyxy: the box of each whose mask was made from it; those of others are the tightest around the masks.
    """
    given = boxes_xyxy or {}
    order = sorted(range(len(found)), key=lambda i: -found[i][1])
    boxes = [given[i] if i in given else box_xyxy(found[i][2]) for i in order]
    return PictureDetections(
        categories=tuple(found[i][0] for i in order),
        scores=np.array([found[i][1] for i in order], np.float32),
        boxes_xyxy=np.array(boxes, np.float32).reshape(-1, 4),
        masks=np.stack([found[i][2] for i in order]) if order else np.zeros((0, *size), bool),
        made_here=tuple(rank for rank, i in enumerate(order) if i in given),
    )


def run_detector(
    detector: Detector, episode: Episode, looked: Callable[[int], object] = lambda views: None
) -> tuple[Detection, ...]:
    """Looks at every view.

    Args:
        detector: any.
        episode: the views.
        looked: is told at how many more views, as soon as it has looked at them.

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
        looked(len(views))
    return tuple(detections)
