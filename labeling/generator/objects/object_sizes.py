"""What the size of an object says of its category: a couch is no chair that is two metres long.

The posterior of an object (``object_posterior``) comes from what the detector says of it in all views. Once the object
is segmented, its size has a say: much in which category it is, a little in whether it is an object at all.
Sizes are those of objects of training scenes (``python -m experiments.calibrate_labels``), as they come out segmented:
partly seen, as often as not.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int

from labeling.generator.cloud.ground import floor_height

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
MIN_RATIO, MAX_RATIO = -1.0, 6.0
"""Bounds of the logarithm of the ratio of densities. An odd size says little: there are odd chairs, and pieces of
chairs; a limit of -1 named more objects of training homes right, left out of the fit, than -6 (91.9 to 91.1 %)."""
MIN_BACKGROUND = 1e-4
MOST_CHANGE = -0.7, 1.5
"""Of the log-odds that there is an object: worlds of others may hold things of other sizes. Without limits the weights
fit training homes no better (log-loss .607 and .614, without sizes .764), and sure detections of toys are lost."""
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
    """Added to the log-odds that there is an object, where the sizes of its categories are known."""

    def posterior(self, posterior: Mapping[str, float], size: Float[np.ndarray, "5"]) -> dict[str, float]:
        """Probabilities of categories given the size, too.

        Among the categories, odds are multiplied by how well the size fits each. The odds that there is an object at
        all follow, within ``MOST_CHANGE``: what is of an odd size may still be what the detector is sure of.

        Args:
            posterior: probability of each category; the rest to 1 is background.
            size: as ``measure_size`` gives it. How likely a category without a known size is beside the others together
                does not change.
        """
        return dict(zip(posterior, self._fitted(posterior, size, self.weight, self.intercept).tolist(), strict=True))

    def _fitted(
        self, posterior: Mapping[str, float], size: Float[np.ndarray, "5"], weight: float, intercept: float
    ) -> Float[np.ndarray, "c"]:
        """``posterior`` with other weights."""
        names = list(posterior)
        known = np.array([name in self.mean and "" in self.mean for name in names], bool)
        ratios = np.array([self.ratio(name, size) if one else 0.0 for name, one in zip(names, known, strict=True)])
        return _reweighed(np.array([posterior[name] for name in names]), ratios, known, weight, intercept)

    def ratio(self, name: str, size: Float[np.ndarray, "5"]) -> float:
        """Logarithm of the ratio of densities of a size, as one of a category and as background, bounded."""
        densities = (_log_density(size, self.mean[one], self.covariance[one]) for one in (name, ""))
        ours, theirs = densities
        return float(np.clip(ours - theirs, MIN_RATIO, MAX_RATIO))


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
            known = np.array([name in sizes.mean and "" in sizes.mean for name in posterior], bool)
            ratios = [sizes.ratio(name, size) if one else 0.0 for name, one in zip(posterior, known, strict=True)]
            true = list(posterior).index(truth) if truth in posterior else -1
            rows.append((np.array([*posterior.values()]), np.array(ratios), known, true))

    def loss(weights):
        total = 0.0
        for chances, ratios, known, true in rows:
            found = _reweighed(chances, ratios, known, *weights)
            total -= np.log(max(found[true] if true >= 0 else 1 - found.sum(), MIN_BACKGROUND))
        return total / max(len(rows), 1)

    weight, intercept = minimize(loss, [0.3, 0.0], bounds=[(0, 1), (-5, 5)], method="Powell").x
    return SizeModel(*_moments(labelled), float(weight), float(intercept))


def _reweighed(chances, ratios, known, weight, intercept) -> Float[np.ndarray, "c"]:
    """Probabilities of the c categories of an object given how well its size fits them.

    Args:
        chances: (c,), before; the rest to 1 is background.
        ratios: (c,), logarithms of the ratio of densities, category to background.
        known: (c,), whose ratio is known.
        weight: of ratios.
        intercept: of the odds that there is an object.
    """
    before = float(chances.sum())
    if before <= 0:
        return chances
    share = chances / before
    exponent, counts = weight * ratios, known & (share > 0)
    highest = float(exponent[counts].max()) if counts.any() else 0.0  # taken out, so that not all underflow
    fit = share * np.exp(np.where(counts, exponent - highest, 0.0))
    named = float(share[known].sum())
    if named > 0:  # of how likely it is that the object is of a category without a size, size says nothing
        fit[~known] = share[~known] * (fit[known].sum() / named)
    change = named * (np.log(fit.sum()) + highest + intercept)
    odds = before / max(1 - before, MIN_BACKGROUND) * np.exp(np.clip(change, *MOST_CHANGE))
    return odds / (1 + odds) * fit / fit.sum()


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
