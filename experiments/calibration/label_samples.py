"""Labels of recorded episodes with the IoU each turned out to have, to fit and check label quality."""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from tqdm import tqdm

from experiments.ablations.label_scores import known_truths
from experiments.calibration.episodes import read_training_episode
from labeling.core.episode import Episode
from labeling.core.episode_labels import EpisodeLabels
from labeling.core.errors import UsageError
from labeling.core.masks import mask_iou
from labeling.core.types import Detection, PseudoLabel
from labeling.generator.calibration.detector_calibration import DetectorCalibration
from labeling.generator.propagate import propagate
from labeling.generator.quality.label_quality import FEATURES, features_of
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.sharing.joined_episodes import join_episodes
from labeling.generator.sharing.label_together import FINER, groups_to_label
from labeling.io.episodes import find_episodes
from labeling.metrics.matching import MaskInstance, instances_of

UNCALIBRATED = LabelConfig(calibrate=False, min_confidence=0, ignore_unconfirmed=1, complete_boxes=False)
"""Labels as they are before their confidence is calibrated, all of them."""


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

    @property
    def categories(self) -> list[str]:
        """Of each label."""
        return [one.category for one in self.masks]

    def predictions(self, confidence: Float[np.ndarray, "n"]) -> list[MaskInstance]:
        """The labels, ranked by these confidences."""
        return [
            MaskInstance(one.image, one.category, one.rle, float(score))
            for one, score in zip(self.masks, confidence, strict=True)
        ]


@dataclass(frozen=True)
class LabelledGroup:
    """Episodes that were labelled together, or one alone, and what was found."""

    episodes: list[Episode]
    detections: list[Detection]
    """Of all episodes, with view indices of the joined recording."""
    found: EpisodeLabels

    def own_labels(self) -> Iterator[tuple[int, PseudoLabel]]:
        """Labels with a visible pixel: the index of the episode, and the label with the index of its own view."""
        starts = np.cumsum([0, *(one.num_views for one in self.episodes)])
        for label in self.found.labels:
            if label.modal.any():
                k = int(np.searchsorted(starts, label.view_index, side="right")) - 1
                yield k, replace(label, view_index=label.view_index - int(starts[k]))


def labelled_groups(
    datasets: Sequence[Path],
    calibration: DetectorCalibration,
    config: LabelConfig,
    together: bool = False,
) -> Iterator[LabelledGroup]:
    """Labels all episodes of some datasets.

    Args:
        datasets: folders of episodes.
        calibration: of their detector.
        config: of label generation.
        together: label the episodes of each scene as one recording, as ``--share-scenes`` does, and not each alone.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth.
    """
    groups = [group for dataset in datasets for group in groups_to_label(find_episodes(dataset))]
    if not together:
        groups = [[folder] for group in groups for folder in group]
    for group in tqdm(groups, desc="labels", unit="scene" if together else "episode", file=sys.stderr):
        episodes = [read_training_episode(folder) for folder in group]
        views, detections = join_episodes(episodes, [one.detections or () for one in episodes])
        finer = replace(config, max_voxels=min(len(group), FINER) * config.max_voxels)
        yield LabelledGroup(episodes, list(detections), propagate(views, detections, finer, calibration))


def label_samples(
    datasets: Sequence[Path], seed: int, calibration: DetectorCalibration, together: bool = False
) -> Samples:
    """Labels all episodes of some datasets; the confidence of labels is not calibrated.

    Args:
        datasets: folders of episodes.
        seed: of label generation.
        calibration: of their detector; only what it says of objects and sizes counts.
        together: label the episodes of each scene as one recording, as ``--share-scenes`` does, and not each alone.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth, or if there is no label at all.
    """
    config = replace(UNCALIBRATED, seed=seed)
    features, rest, scenes, masks, truths, origins = [np.zeros((0, len(FEATURES)))], [], [], [], [], []
    for group in labelled_groups(datasets, calibration, config, together):
        shown = np.array([one.modal.any() for one in group.found.labels], bool)
        features.append(features_of(group.found, group.detections)[shown])
        for k, own in group.own_labels():
            rest.append((own.confidence, *_compared(own, group.episodes[k])))
            masks += instances_of(len(origins) + k, [own])
            scenes.append(_scene(group))
        for episode in group.episodes:
            truths += known_truths(episode, len(origins))
            origins.append(_origin(episode))
    if not rest:
        raise UsageError("the label generator finds nothing in these episodes")
    confidence, iou, ignored = (np.array(column) for column in zip(*rest, strict=True))
    return Samples(np.concatenate(features), confidence, iou, ignored, scenes, tuple(masks), tuple(truths), origins)


def _scene(group: LabelledGroup) -> str:
    first = group.episodes[0]
    return str(first.metadata.get("scene", first.name))


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
