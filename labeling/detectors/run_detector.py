"""Runs a detector on the views of an episode."""

from functools import lru_cache
from typing import Any

from labeling.core.detector import Detector, DetectorError
from labeling.core.episode import Episode
from labeling.core.types import Detection
from labeling.detectors.registry import load_detector, run_weights


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


def detector_by_name(name: str) -> Detector:
    """The detector of this name; loaded once, and again when its weights have changed.

    Raises:
        SbmError: if there is none, or its files are missing or damaged.
    """
    weights = run_weights(name)
    stamp = weights.stat() if weights.is_file() else None
    return _loaded(name, stamp and (stamp.st_mtime_ns, stamp.st_size))


@lru_cache(maxsize=2)
def _loaded(name: str, stamp: Any) -> Detector:
    return load_detector(name)
