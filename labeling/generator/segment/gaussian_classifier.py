"""The classifier of an object: the mean of a support vector machine and of one Gaussian per class.

The machine follows every seed, so where detections miss the same part of an object in every view it learns to leave it
out; one Gaussian per class cannot, and closes the shape. Where seeds are plenty the machine is more exact.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64

from labeling.generator.segment.svm_classifier import SvmClassifier, train_svm_classifier

RIDGE = 0.005
"""Added to the variances of standardised features: a flat object has a covariance that can be inverted."""
HELD_LOG_ODDS = float(np.log(0.99 / 0.01))
"""Either classifier's log-odds are held within this before they are averaged. Source: field notes (published code)."""


@dataclass(frozen=True)
class GaussianClassifier:
    """Quadratic discriminant analysis: ``x' A x + b' x + c`` on scaled features, both classes equally likely before."""

    scale: Float64[np.ndarray, "d"]
    matrix: Float32[np.ndarray, "d d"]
    vector: Float32[np.ndarray, "d"]
    constant: float

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row of features (same units as in training)."""
        scaled = (features / self.scale).astype(np.float32)
        form = np.zeros(len(scaled), np.float32)
        for i in range(scaled.shape[1]):  # column by column: the same sums on any number of threads
            inner = np.full(len(scaled), self.vector[i], np.float32)
            for j in range(scaled.shape[1]):
                inner += self.matrix[i, j] * scaled[:, j]
            form += inner * scaled[:, i]
        return form + np.float32(self.constant)


@dataclass(frozen=True)
class MixedClassifier:
    """Weighted mean of the log-odds of both classifiers."""

    gaussians: GaussianClassifier
    machine: SvmClassifier
    share: float
    """Weight of the Gaussians."""

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row of features (same units as in training)."""
        smooth = np.clip(self.gaussians.log_odds(features), -HELD_LOG_ODDS, HELD_LOG_ODDS)
        exact = np.clip(self.machine.log_odds(features), -HELD_LOG_ODDS, HELD_LOG_ODDS)
        return np.float32(self.share) * smooth + np.float32(1 - self.share) * exact


def train_gaussian_classifier(
    foreground: Float[np.ndarray, "f d"], background: Float[np.ndarray, "b d"]
) -> GaussianClassifier:
    """Fits a Gaussian to each class (at least 1 point each)."""
    scale = np.concatenate([foreground, background]).astype(float).std(axis=0)
    scale = np.where(scale > 1e-9, scale, 1.0)
    forms = []
    for points in (foreground, background):
        scaled = points / scale
        centre = scaled.mean(axis=0)
        spread = scaled - centre
        covariance = spread.T @ spread / max(len(points) - 1, 1) + RIDGE * np.eye(len(scale))
        inverse = np.linalg.inv(covariance)
        vector = inverse @ centre
        forms.append((-0.5 * inverse, vector, -0.5 * centre @ vector - 0.5 * np.linalg.slogdet(covariance)[1]))
    (a, b, c), (d, e, f) = forms
    return GaussianClassifier(scale, (a - d).astype(np.float32), (b - e).astype(np.float32), float(c - f))


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
