"""Labels of recorded episodes with the IoU each turned out to have, to fit and check label quality."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from experiments.ablations.label_scores import known_truths
from experiments.calibration.episodes import training_episodes
from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.core.masks import mask_iou
from labeling.core.types import PseudoLabel
from labeling.generator.calibration.detector_calibration import DetectorCalibration
from labeling.generator.propagate import propagate
from labeling.generator.quality.label_quality import FEATURES, features_of
from labeling.generator.settings.label_config import LabelConfig
from labeling.metrics.matching import MaskInstance, instances_of


@dataclass(frozen=True)
class Samples:
    """Labels with a visible pixel."""

    features: Float[np.ndarray, "n f"]
    confidence: Float[np.ndarray, "n"]
    """Before calibration."""
    iou: Float[np.ndarray, "n"]
    """With the ground truth of the label's name that overlaps it most; 0 for none."""
    ignored: Bool[np.ndarray, "n"]
    """That ground truth is one to be ignored."""
    masks: tuple[MaskInstance, ...]
    truths: tuple[MaskInstance, ...]
    origins: list[str]
    """World, scene and seed of the episodes."""

    def predictions(self, confidence: Float[np.ndarray, "n"]) -> list[MaskInstance]:
        """The labels, ranked by these confidences."""
        return [
            MaskInstance(one.image, one.category, one.rle, float(score))
            for one, score in zip(self.masks, confidence, strict=True)
        ]


def label_samples(datasets: Sequence[Path], seed: int, calibration: DetectorCalibration) -> Samples:
    """Labels all episodes of some datasets; the confidence of labels is not calibrated.

    Args:
        datasets: folders of episodes.
        seed: of label generation.
        calibration: of their detector; only what it says of objects counts.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth, or if there is no label at all.
    """
    config = LabelConfig(calibrate=False, min_confidence=0, ignore_unconfirmed=1, complete_boxes=False, seed=seed)
    features, rest, masks, truths, origins = [np.zeros((0, len(FEATURES)))], [], [], [], []
    for number, episode in enumerate(training_episodes(datasets, "labels")):
        detections = episode.detections or ()
        found = propagate(episode, detections, config, calibration)
        features.append(features_of(found, detections)[[one.modal.any() for one in found.labels]])
        visible = [one for one in found.labels if one.modal.any()]
        rest += [(one.confidence, *_compared(one, episode)) for one in visible]
        masks += instances_of(number, visible)
        truths += known_truths(episode, number)
        origins.append(_origin(episode))
    if not rest:
        raise UsageError("the label generator finds nothing in these episodes")
    confidence, iou, ignored = (np.array(column) for column in zip(*rest, strict=True))
    return Samples(np.concatenate(features), confidence, iou, ignored, tuple(masks), tuple(truths), origins)


def _compared(label: PseudoLabel, episode: Episode) -> tuple[float, bool]:
    """IoU with the ground truth that the label names, and whether that is one to be ignored."""
    ious = [
        (mask_iou(label.modal, truth.modal), truth.ignore)
        for truth in episode.ground_truth or ()
        if truth.view_index == label.view_index and truth.category == label.category
    ]
    best = max(ious, default=(0.0, False))
    return best if best[0] > 0 else (0.0, False)


def _origin(episode: Episode) -> str:
    about = episode.metadata
    stated = [f"{key} {about[key]}" for key in ("world", "scene", "seed", "episode", "detector") if key in about]
    return ", ".join(stated) or episode.name
