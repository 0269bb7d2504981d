"""Labels of recorded episodes with the IoU each turned out to have, to fit and check label quality."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from experiments.ablations.label_scores import known_truths
from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.core.masks import mask_iou
from labeling.core.types import PseudoLabel
from labeling.generator.propagate import propagate
from labeling.generator.quality.label_quality import FEATURES, features_of
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import find_episodes, read_episode
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


def samples_of(datasets: Sequence[Path], seed: int) -> Samples:
    """Labels all episodes of some datasets, without calibration.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth, or if there is no label at all.
    """
    config = LabelConfig(calibrate=False, min_confidence=0, ignore_unconfirmed=1, complete_boxes=False, seed=seed)
    features, rest, masks, truths, origins = [np.zeros((0, len(FEATURES)))], [], [], [], []
    folders = [folder for dataset in datasets for folder in find_episodes(dataset)]
    for number, folder in enumerate(tqdm(folders, desc="labelling", unit="episode", file=sys.stderr)):
        episode = read_episode(folder)
        if episode.ground_truth is None or episode.detections is None:
            raise UsageError(f"{folder}: needs detections.json and ground_truth.json")
        found = propagate(episode, episode.detections, config)
        features.append(features_of(found, episode.detections)[[one.modal.any() for one in found.labels]])
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
