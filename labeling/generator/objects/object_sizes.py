"""What the size of an object says of its category: a couch is no chair that is two metres long.

The posterior of an object (``object_posterior``) comes from what the detector says of it in all views. Once the object
is segmented, the odds of each category are multiplied by how much better its size fits this category than background.
Sizes are those of objects of training scenes (``python -m experiments.calibrate_labels``), as they come out segmented:
partly seen, as often as not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float32, Int, Int32

from labeling.generator.cloud.ground import floor_height
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate

FEATURES = ("length", "width", "height", "bottom", "top")
"""length, width: logarithms of the extents along both horizontal principal axes, metres. height: the logarithm of the
extent upwards, metres. bottom, top: metres above the floor."""
TAIL = 0.02
"""Share of an object's points beyond each end that extents leave out."""
LEAST_M = 0.04
"""Lengths below count as this: what is flat has no width that could be measured."""
LEAST_POINTS = 10
"""Objects of fewer points have no size."""
LEAST_SAMPLES = 8
"""Categories with fewer objects to learn from say nothing."""
MEAN_PRIOR, COVARIANCE_PRIOR = 3, 5
"""How many objects of any kind each category's mean and covariance are drawn towards those of."""
MAX_RATIO = 6.0
"""Most that the logarithm of the ratio of densities may say, either way."""
MIN_BACKGROUND = 1e-4
FLOOR_LAYER_M = 0.05
"""Thickness of the layers of points among which the floor is looked for."""


@dataclass(frozen=True)
class SizeModel:
    """Sizes of objects by category and of background, each a normal distribution over ``FEATURES``."""

    mean: Mapping[str, Float[np.ndarray, "5"]]
    """By category; ``""`` is background."""
    covariance: Mapping[str, Float[np.ndarray, "5 5"]]
    weight: float
    """Of the logarithm of the ratio of densities, category to background: features of one object are not independent
    of what the detector says."""
    intercept: float
    """Added to the log-odds of all categories whose size is known."""

    def posterior(self, posterior: Mapping[str, float], size: Float[np.ndarray, "5"]) -> dict[str, float]:
        """Probabilities of categories given the size, too.

        Args:
            posterior: probability of each category; the rest to 1 is background.
            size: as ``measure_size`` gives it. Categories without a known size keep their odds.
        """
        background = max(1 - sum(posterior.values()), MIN_BACKGROUND)
        odds = {
            name: chance / background * np.exp(np.clip(self._gain(name, size), -30, 30))
            for name, chance in posterior.items()
        }
        total = 1 + sum(odds.values())
        return {name: float(one / total) for name, one in odds.items()}

    def _gain(self, name: str, size: Float[np.ndarray, "5"]) -> float:
        if name not in self.mean or "" not in self.mean:
            return 0.0
        return self.weight * self.ratio(name, size) + self.intercept

    def ratio(self, name: str, size: Float[np.ndarray, "5"]) -> float:
        """Logarithm of the ratio of densities of a size, as one of a category and as background, bounded."""
        densities = (_log_density(size, self.mean[one], self.covariance[one]) for one in (name, ""))
        ours, theirs = densities
        return float(np.clip(ours - theirs, -MAX_RATIO, MAX_RATIO))


def measure_sizes(
    points: Float32[np.ndarray, "n 3"], owner: Int[np.ndarray, "n"], numbers: Sequence[int]
) -> list[Float[np.ndarray, "5"] | None]:
    """``FEATURES`` of objects; None for those of too few points.

    Args:
        points: of a scene, metres, world; +Z is up.
        owner: which object each belongs to.
        numbers: the objects that are asked for.
    """
    if len(points) == 0:
        return [None] * len(numbers)
    floor_m = floor_height(points, FLOOR_LAYER_M)
    return [measure_size(points[owner == number], floor_m) for number in numbers]


def measure_size(points: Float32[np.ndarray, "n 3"], floor_m: float) -> Float[np.ndarray, "5"] | None:
    """``FEATURES`` of an object; None if it has too few points.

    Args:
        points: of the object, metres, world; +Z is up.
        floor_m: height of the floor.
    """
    if len(points) < LEAST_POINTS:
        return None
    bottom, top = np.quantile(points[:, 2], (TAIL, 1 - TAIL)) - floor_m
    flat = points[:, :2].astype(float) - points[:, :2].mean(axis=0)
    _, axes = np.linalg.eigh(flat.T @ flat)
    low, high = np.quantile(flat @ axes, (TAIL, 1 - TAIL), axis=0)
    width, length = high - low
    lengths = np.log(np.maximum([length, width, top - bottom], LEAST_M))
    return np.array([*lengths, bottom, top])


def with_sizes(
    cloud: Cloud, candidates: Sequence[Candidate], owner: Int32[np.ndarray, "n"], model: SizeModel
) -> list[Candidate]:
    """Candidates whose posterior knows their size; those without a posterior, and without points, are as they were.

    Args:
        cloud: the points of all views.
        candidates: objects.
        owner: which of them each point belongs to, -1 for none.
        model: sizes of categories.
    """
    sizes = measure_sizes(cloud.points, owner, range(len(candidates)))
    return [
        one if one.posterior is None or size is None else replace(one, posterior=model.posterior(one.posterior, size))
        for one, size in zip(candidates, sizes, strict=True)
    ]


def fit_size_model(
    samples: Sequence[tuple[Mapping[str, float], Float[np.ndarray, "5"], str | None]], folds: int = 3
) -> SizeModel:
    """Fits sizes to objects of training scenes, and their weight to odds that these sizes were not fitted to.

    Args:
        samples: for each object the probabilities of its categories, its size, and its true category; None, or one that
            no probability names, is background.
        folds: parts of the samples, in turn left out of the fit of sizes, that the weight is fitted to.
    """
    from scipy.optimize import minimize

    known = {name for posterior, _, _ in samples for name in posterior}
    labelled = [(posterior, size, truth if truth in known else "") for posterior, size, truth in samples]
    part = np.arange(len(labelled)) * folds // max(len(labelled), 1)  # neighbours are of one scene
    rows = []
    for fold in range(folds):
        sizes = SizeModel(*_moments([one for one, k in zip(labelled, part, strict=True) if k != fold]), 0.0, 0.0)
        for posterior, size, truth in (one for one, k in zip(labelled, part, strict=True) if k == fold):
            background = max(1 - sum(posterior.values()), MIN_BACKGROUND)
            named = [name for name in posterior if name in sizes.mean and posterior[name] > 0]
            ratios = np.array([sizes.ratio(name, size) for name in named] if "" in sizes.mean else [])
            odds = np.log([posterior[name] / background for name in named])
            rows.append((odds, ratios, named.index(truth) if truth in named else -1))

    def loss(weights):
        total = 0.0
        for odds, ratios, true in rows:
            if len(ratios):
                utility = np.clip(odds + weights[0] * ratios + weights[1], -30, 30)
                total += np.log1p(np.exp(utility).sum()) - (utility[true] if true >= 0 else 0.0)
        return total / max(len(rows), 1)

    weight, intercept = minimize(loss, np.zeros(2), bounds=[(0, 1), (None, None)], method="L-BFGS-B").x
    return SizeModel(*_moments(labelled), float(weight), float(intercept))


def _moments(
    samples: Sequence[tuple[Mapping[str, float], Float[np.ndarray, "5"], str]],
) -> tuple[dict[str, Float[np.ndarray, "5"]], dict[str, Float[np.ndarray, "5 5"]]]:
    """Mean and covariance of the sizes of each category with enough objects, drawn towards those of all objects."""
    every = np.array([size for _, size, _ in samples])
    if len(every) < LEAST_SAMPLES:
        return {}, {}
    centre, spread = every.mean(axis=0), np.cov(every.T) + 1e-6 * np.eye(len(FEATURES))
    means, covariances = {}, {}
    for name in sorted({truth for _, _, truth in samples}):
        own = np.array([size for _, size, truth in samples if truth == name])
        if len(own) >= LEAST_SAMPLES:
            mean = (own.sum(axis=0) + MEAN_PRIOR * centre) / (len(own) + MEAN_PRIOR)
            away = own - mean
            means[name] = mean
            covariances[name] = (away.T @ away + COVARIANCE_PRIOR * spread) / (len(own) + COVARIANCE_PRIOR)
    return means, covariances


def _log_density(size, mean, covariance) -> float:
    """Of a normal distribution, but for a constant."""
    away = size - mean
    return float(-0.5 * (away @ np.linalg.solve(covariance, away) + np.linalg.slogdet(covariance)[1]))
