"""Frustums as augmented samples and batches to train on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32
from torch.utils.data import Dataset

from labeling.detectors3d.config import NO_AUGMENTATION_3D, Augment3dConfig
from labeling.detectors3d.frustum_losses import FrustumBatch
from labeling.detectors3d.frustum_samples import MIN_POINTS, FrustumSample
from labeling.detectors3d.upright_boxes import HALF_TURN, encode_box

TrainingSample = tuple[np.ndarray, int, np.ndarray, np.ndarray, float]
"""Points (num_points, 3) float32 in the frustum frame, index of the category, foreground (num_points,) bool, box (7,)
float32 as ``labeling.detectors3d.upright_boxes`` encodes it, weight."""


@dataclass(frozen=True)
class FrustumDataset(Dataset):
    """An endless stream of augmented samples, each a function of its number; objects are drawn in shuffled rounds."""

    samples: Sequence[FrustumSample]
    """Of categories that are all known."""
    categories: tuple[str, ...]
    """The network's."""
    num_points: int
    """Of a frustum."""
    augmentation: Augment3dConfig
    seed: int
    """Of order, augmentation and choice of points."""
    trust_scores: bool = True
    """Weight samples by their scores."""

    def __getitem__(self, number: int) -> TrainingSample:
        turn, place = divmod(number, len(self.samples))
        order = np.random.default_rng([self.seed, 0, turn]).permutation(len(self.samples))
        sample = self.samples[order[place]]
        rng = np.random.default_rng([self.seed, 1, number])
        points, foreground, box = augmented(sample, self.augmentation, rng)
        chosen = resample_points(len(points), self.num_points, rng)
        weight = sample.weight if self.trust_scores else 1.0
        return points[chosen], self.categories.index(sample.category), foreground[chosen], box, weight


def augmented(
    sample: FrustumSample, config: Augment3dConfig, rng: np.random.Generator
) -> tuple[Float32[np.ndarray, "n 3"], Bool[np.ndarray, "n"], Float32[np.ndarray, "7"]]:
    """A sample seen through a slightly different 2-D box, a little nearer or farther, perhaps mirrored.

    Returns:
        Points in the frustum frame, which of them are the object's, and its box.
    """
    left, top, right, bottom = sample.box_xyxy
    width, height = right - left, bottom - top
    shift_x, shift_y = rng.uniform(-config.box_shift, config.box_shift, 2)
    scale_x, scale_y = 1 + rng.uniform(-config.box_scale, config.box_scale, 2)
    x, y = 0.5 * (left + right) + shift_x * width, 0.5 * (top + bottom) + shift_y * height
    half_x, half_y = 0.5 * scale_x * width, 0.5 * scale_y * height
    frustum, foreground = sample.crop((x - half_x, y - half_y, x + half_x, y + half_y))
    if np.count_nonzero(foreground) < MIN_POINTS // 2:
        frustum, foreground = sample.crop(sample.box_xyxy)
    points = frustum.points.astype(np.float32)
    box = encode_box(frustum.from_world(sample.box))
    distance = float(np.linalg.norm(box[:2]))
    along = rng.uniform(-config.range_shift, config.range_shift) * distance
    points, box = points + np.array([along, 0, 0], np.float32), box + np.array([along, 0, 0, 0, 0, 0, 0])
    if rng.random() < config.flip:
        points, box = points * np.array([1, -1, 1], np.float32), box * np.array([1, -1, 1, 1, 1, 1, 1])
        box[6] = np.mod(-box[6], HALF_TURN)
    if config.noise_m > 0:
        points = points + rng.normal(0, config.noise_m, points.shape).astype(np.float32)
    return points, foreground, box.astype(np.float32)


def resample_points(available: int, wanted: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of points in random order: no point twice if there are enough, else every point at least once."""
    order = rng.permutation(available)
    return order[np.arange(wanted) % available] if available < wanted else order[:wanted]


def collate(samples: Sequence[TrainingSample]) -> FrustumBatch:
    """Samples in one batch."""
    points, category, foreground, box, weight = zip(*samples, strict=True)
    return FrustumBatch(
        points=torch.from_numpy(np.stack(points)),
        category=torch.tensor(category),
        foreground=torch.from_numpy(np.stack(foreground).astype(np.float32)),
        boxes=torch.from_numpy(np.stack(box)),
        weights=torch.tensor(weight, dtype=torch.float32),
    )


def unaugmented(sample: FrustumSample, categories: Sequence[str], num_points: int) -> TrainingSample:
    """A sample without augmentation; the same at every call."""
    points, foreground, box = augmented(sample, NO_AUGMENTATION_3D, np.random.default_rng(0))
    chosen = resample_points(len(points), num_points, np.random.default_rng(0))
    return points[chosen], list(categories).index(sample.category), foreground[chosen], box, sample.weight
