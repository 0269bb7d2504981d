"""The classifier of an object: the mean of a support vector machine and of one Gaussian per class.

The machine follows every seed, so where detections miss the same part of an object in every view it learns to leave it
out; one Gaussian per class cannot, and closes the shape. Where seeds are plenty the machine is more exact.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from numba import njit

from labeling.generator.segment.svm_classifier import SvmClassifier, train_svm_classifier

RIDGE = 0.005
"""Added to the variances of standardised features: a flat object has a covariance that can be inverted."""
MAX_LOG_ODDS = float(np.log(0.99 / 0.01))
"""Log-odds of classifiers are clipped to this: probabilities in [.01, .99]. Source: field notes (published code)."""


@dataclass(frozen=True)
class GaussianClassifier:
    """Quadratic discriminant analysis: ``x' A x + b' x + c`` on scaled features, both classes equally likely before."""

    scale: Float64[np.ndarray, "d"]
    matrix: Float32[np.ndarray, "d d"]
    vector: Float32[np.ndarray, "d"]
    constant: float

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row of features (same units as in training)."""
        scaled = np.ascontiguousarray(features / self.scale, np.float32)
        return _quadratic(scaled, self.matrix, self.vector, np.float32(self.constant))


@njit(cache=True, nogil=True)
def _quadratic(rows, matrix, vector, constant):  # pragma: no cover - compiled
    """``x' matrix x + vector' x + constant`` of each of the ``rows`` (n, d), (n,) float32."""
    values = np.empty(len(rows), np.float32)
    for n in range(len(rows)):
        total = constant
        for i in range(rows.shape[1]):
            inner = vector[i]
            for j in range(rows.shape[1]):
                inner += matrix[i, j] * rows[n, j]
            total += inner * rows[n, i]
        values[n] = total
    return values


@dataclass(frozen=True)
class MixedClassifier:
    """Weighted mean of the log-odds of both classifiers."""

    gaussians: GaussianClassifier
    machine: SvmClassifier
    share: float
    """Weight of the Gaussians."""

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row of features (same units as in training)."""
        smooth = np.clip(self.gaussians.log_odds(features), -MAX_LOG_ODDS, MAX_LOG_ODDS)
        exact = np.clip(self.machine.log_odds(features), -MAX_LOG_ODDS, MAX_LOG_ODDS)
        return np.float32(self.share) * smooth + np.float32(1 - self.share) * exact


def train_gaussian_classifier(
    foreground: Float[np.ndarray, "f d"],
    background: Float[np.ndarray, "b d"],
    hard: Bool[np.ndarray, "b"] | None = None,
) -> GaussianClassifier:
    """Fits a Gaussian to each class.

    Args:
        foreground: features of safe foreground points (at least 1).
        background: features of safe background points (at least 1).
        hard: those of the background that count as much as the whole background does; None if all count the same.
    """
    front, back = _Moments.of(foreground), _Moments.of(background)
    if hard is not None and hard.any():
        back = back.mixed_with(_Moments.of(background[hard]))
    # Both classes count the same, however many points each has.
    scale = np.sqrt(np.maximum(np.diag(front.mixed_with(back).covariance), 0.0))
    scale = np.where(scale > 1e-9, scale, 1.0)
    forms = []
    for one in (front, back):
        centre = one.mean / scale
        covariance = one.covariance / np.outer(scale, scale) * one.count / max(one.count - 1, 1)
        covariance += RIDGE * np.eye(len(scale))
        inverse = np.linalg.inv(covariance)
        vector = inverse @ centre
        forms.append((-0.5 * inverse, vector, -0.5 * centre @ vector - 0.5 * np.linalg.slogdet(covariance)[1]))
    (a, b, c), (d, e, f) = forms
    return GaussianClassifier(scale, (a - d).astype(np.float32), (b - e).astype(np.float32), float(c - f))


@dataclass(frozen=True)
class _Moments:
    """Mean and covariance of some points."""

    count: int
    mean: Float64[np.ndarray, "d"]
    covariance: Float64[np.ndarray, "d d"]
    """Mean product of deviations from the mean."""

    @classmethod
    def of(cls, rows: Float[np.ndarray, "n d"]) -> "_Moments":
        """Those of the rows, the same on any number of threads."""
        return cls(len(rows), *_moments(np.ascontiguousarray(rows, np.float64)))

    def mixed_with(self, other: "_Moments") -> "_Moments":
        """Those of points of which either kind makes up a half."""
        apart = 0.5 * (self.mean - other.mean)
        covariance = 0.5 * (self.covariance + other.covariance) + np.outer(apart, apart)
        return _Moments(self.count + other.count, 0.5 * (self.mean + other.mean), covariance)


@njit(cache=True, nogil=True)
def _moments(rows):  # pragma: no cover - compiled
    """Mean (d,) and covariance (d, d) of ``rows`` (n, d) float64."""
    n, d = rows.shape
    mean, covariance = np.zeros(d), np.zeros((d, d))
    for row in range(n):
        for i in range(d):
            mean[i] += rows[row, i]
    mean /= n
    apart = np.empty(d)
    for row in range(n):
        for i in range(d):
            apart[i] = rows[row, i] - mean[i]
        for i in range(d):
            for j in range(i + 1):
                covariance[i, j] += apart[i] * apart[j]
    for i in range(d):
        for j in range(i + 1):
            covariance[i, j] /= n
            covariance[j, i] = covariance[i, j]
    return mean, covariance


def train_classifier(
    foreground: Float[np.ndarray, "f d"], background: Float[np.ndarray, "b d"], rng: np.random.Generator, share: float
) -> SvmClassifier | GaussianClassifier | MixedClassifier:
    """Trains the classifier of one object.

    Args:
        foreground: features of safe foreground points (at least 1).
        background: features of safe background points (at least 1).
        rng: chooses the machine's hold-out.
        share: weight of the Gaussians; 0 for the machine alone (thesis 4.3), 1 for them alone.
    """
    if share <= 0:
        return train_svm_classifier(foreground, background, rng)
    gaussians = train_gaussian_classifier(foreground, background)
    return (
        gaussians
        if share >= 1
        else MixedClassifier(gaussians, train_svm_classifier(foreground, background, rng), share)
    )
