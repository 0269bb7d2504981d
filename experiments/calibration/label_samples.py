"""Labels of recorded episodes with the IoU each turned out to have, to fit and check label quality."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from experiments.ablations.label_scores import known_truths
from experiments.calibration.episodes import read_training_episode
from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.core.masks import mask_iou
from labeling.core.types import PseudoLabel
from labeling.generator.calibration.detector_calibration import DetectorCalibration
from labeling.generator.propagate import propagate
from labeling.generator.quality.label_quality import FEATURES, features_of
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.sharing.joined_episodes import join_episodes
from labeling.generator.sharing.label_together import FINER, groups_to_label
from labeling.io.episodes import find_episodes
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
    scene: list[str]
    """Where each label is."""
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


def label_samples(
    datasets: Sequence[Path], seed: int, calibration: DetectorCalibration, together: bool = False
) -> Samples:
    """Labels all episodes of some datasets; the confidence of labels is not calibrated.

    Args:
        datasets: folders of episodes.
        seed: of label generation.
        calibration: of their detector; only what it says of objects counts.
        together: label the episodes of each scene as one recording, as ``--share-scenes`` does, and not each alone.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth, or if there is no label at all.
    """
    config = LabelConfig(calibrate=False, min_confidence=0, ignore_unconfirmed=1, complete_boxes=False, seed=seed)
    groups = [group for dataset in datasets for group in groups_to_label(find_episodes(dataset))]
    if not together:
        groups = [[folder] for group in groups for folder in group]
    features, rest, scenes, masks, truths, origins = [np.zeros((0, len(FEATURES)))], [], [], [], [], []
    for group in tqdm(groups, desc="labels", unit="scene" if together else "episode", file=sys.stderr):
        episodes = [read_training_episode(folder) for folder in group]
        views, detections = join_episodes(episodes, [one.detections or () for one in episodes])
        finer = replace(config, max_voxels=min(len(group), FINER) * config.max_voxels)
        found = propagate(views, detections, finer, calibration)
        shown = np.array([one.modal.any() for one in found.labels], bool)
        features.append(features_of(found, detections)[shown])
        starts = np.cumsum([0, *(one.num_views for one in episodes)])
        for label in (one for one, visible in zip(found.labels, shown, strict=True) if visible):
            k = int(np.searchsorted(starts, label.view_index, side="right")) - 1
            own = replace(label, view_index=label.view_index - int(starts[k]))
            rest.append((own.confidence, *_compared(own, episodes[k])))
            masks += instances_of(len(origins) + k, [own])
            scenes.append(str(episodes[k].metadata.get("scene", group[0])))
        for episode in episodes:
            truths += known_truths(episode, len(origins))
            origins.append(_origin(episode))
    if not rest:
        raise UsageError("the label generator finds nothing in these episodes")
    confidence, iou, ignored = (np.array(column) for column in zip(*rest, strict=True))
    return Samples(np.concatenate(features), confidence, iou, ignored, scenes, tuple(masks), tuple(truths), origins)


def joined_samples(parts: Sequence[Samples]) -> Samples:
    """Samples of several kinds as one, to fit to; pictures of one may bear the number of another's."""
    arrays = ("features", "confidence", "iou", "ignored")
    columns = {name: np.concatenate([getattr(one, name) for one in parts]) for name in arrays}
    scenes = [name for one in parts for name in one.scene]
    origins = list(dict.fromkeys(name for one in parts for name in one.origins))
    masks, truths = (tuple(x for one in parts for x in getattr(one, name)) for name in ("masks", "truths"))
    return Samples(**columns, scene=scenes, masks=masks, truths=truths, origins=origins)


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
