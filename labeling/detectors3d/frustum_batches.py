"""Batches of frustums, augmented."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32
from torch.utils.data import DataLoader, Dataset

from labeling.detectors3d.frustum_dataset import LEAST_POINTS, Lesson
from labeling.detectors3d.frustum_losses import FrustumBatch
from labeling.detectors3d.train_config import NO_AUGMENTATION_3D, Augment3dConfig
from labeling.detectors3d.upright_boxes import HALF_TURN, to_numbers

Sample = tuple[np.ndarray, int, np.ndarray, np.ndarray, float]
"""Points (n, 3), category, own (n,), box (7,), weight."""


@dataclass(frozen=True)
class Samples(Dataset):
    """An endless stream of samples, each a function of its number; lessons are drawn in shuffled rounds."""

    lessons: Sequence[Lesson]
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

    def __getitem__(self, number: int) -> Sample:
        turn, place = divmod(number, len(self.lessons))
        order = np.random.default_rng([self.seed, 0, turn]).permutation(len(self.lessons))
        lesson = self.lessons[order[place]]
        rng = np.random.default_rng([self.seed, 1, number])
        points, own, box = augmented(lesson, self.augmentation, rng)
        chosen = choose(len(points), self.num_points, rng)
        weight = lesson.weight if self.trust_scores else 1.0
        return points[chosen], self.categories.index(lesson.category), own[chosen], box, weight


def augmented(
    lesson: Lesson, config: Augment3dConfig, rng: np.random.Generator
) -> tuple[Float32[np.ndarray, "n 3"], Bool[np.ndarray, "n"], Float32[np.ndarray, "7"]]:
    """A lesson seen through a slightly different 2-D box, a little nearer or farther, perhaps mirrored.

    Returns:
        Points in the frustum frame, which of them are the object's, and its box.
    """
    left, top, right, bottom = lesson.box_xyxy
    width, height = right - left, bottom - top
    shift_x, shift_y = rng.uniform(-config.box_shift, config.box_shift, 2)
    scale_x, scale_y = 1 + rng.uniform(-config.box_scale, config.box_scale, 2)
    x, y = 0.5 * (left + right) + shift_x * width, 0.5 * (top + bottom) + shift_y * height
    half_x, half_y = 0.5 * scale_x * width, 0.5 * scale_y * height
    frustum, own = lesson.cut((x - half_x, y - half_y, x + half_x, y + half_y))
    if np.count_nonzero(own) < LEAST_POINTS // 2:
        frustum, own = lesson.cut(lesson.box_xyxy)
    points = frustum.points.astype(np.float32)
    box = to_numbers(frustum.from_world(lesson.box))
    distance = float(np.linalg.norm(box[:2]))
    along = rng.uniform(-config.range_shift, config.range_shift) * distance
    points, box = points + np.array([along, 0, 0], np.float32), box + np.array([along, 0, 0, 0, 0, 0, 0])
    if rng.random() < config.flip:
        points, box = points * np.array([1, -1, 1], np.float32), box * np.array([1, -1, 1, 1, 1, 1, 1])
        box[6] = np.mod(-box[6], HALF_TURN)
    if config.noise_m > 0:
        points = points + rng.normal(0, config.noise_m, points.shape).astype(np.float32)
    return points, own, box.astype(np.float32)


def choose(available: int, wanted: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of points in random order: no point twice if there are enough, else every point at least once."""
    order = rng.permutation(available)
    return order[np.arange(wanted) % available] if available < wanted else order[:wanted]


def collate(samples: Sequence[Sample]) -> FrustumBatch:
    """Puts samples together."""
    points, category, own, box, weight = zip(*samples, strict=True)
    return FrustumBatch(
        points=torch.from_numpy(np.stack(points)),
        category=torch.tensor(category),
        own=torch.from_numpy(np.stack(own).astype(np.float32)),
        boxes=torch.from_numpy(np.stack(box)),
        weights=torch.tensor(weight, dtype=torch.float32),
    )


def batches(samples: Samples, size: int, first: int, count: int, workers: int = 0) -> Iterator[FrustumBatch]:
    """Batches ``first`` to ``first + count`` of a stream, prepared in so many processes (0: here)."""
    numbers = [list(range(size * batch, size * (batch + 1))) for batch in range(first, first + count)]
    yield from DataLoader(
        samples,
        batch_sampler=numbers,
        collate_fn=collate,
        num_workers=workers,
        multiprocessing_context="spawn" if workers else None,
    )


def plain_sample(lesson: Lesson, categories: Sequence[str], num_points: int) -> Sample:
    """A lesson as it is; the same at every call."""
    points, own, box = augmented(lesson, NO_AUGMENTATION_3D, np.random.default_rng(0))
    chosen = choose(len(points), num_points, np.random.default_rng(0))
    return points[chosen], list(categories).index(lesson.category), own[chosen], box, lesson.weight
