"""Which classifier learns an object from its seeds: ``LabelConfig.unary`` names one."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Float32, Float64

from labeling.generator.segment.gaussian_classifier import train_mixed_classifier
from labeling.generator.segment.svm_classifier import fit_platt
from labeling.generator.settings.label_config import UnaryName


class Classifier(Protocol):
    """Anything that gives log-odds of the object to rows of features."""

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row."""
        ...


@dataclass(frozen=True)
class Quadratic:
    """Log-odds that are quadratic in the features, ``x' A x + b' x + c``, calibrated by a line."""

    mean: Float64[np.ndarray, "d"]
    std: Float64[np.ndarray, "d"]
    matrix: Float64[np.ndarray, "d d"]
    vector: Float64[np.ndarray, "d"]
    constant: float
    platt: tuple[float, float] = (1.0, 0.0)
    """Slope and offset."""

    def decision(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """The quadratic form before calibration."""
        scaled = ((features - self.mean) / self.std).astype(np.float32)
        form = np.einsum("ni,ni->n", scaled @ self.matrix.astype(np.float32), scaled)
        return form + scaled @ self.vector.astype(np.float32) + np.float32(self.constant)

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row of features (same units as in training)."""
        return (self.platt[0] * self.decision(features) + self.platt[1]).astype(np.float32)


def train_classifier(
    name: UnaryName,
    foreground: Float[np.ndarray, "f d"],
    background: Float[np.ndarray, "b d"],
    rng: np.random.Generator,
    gaussian_share: float = 0.0,
) -> Classifier | None:
    """Trains the classifier of one object.

    Args:
        name: "svm" (thesis 4.3), "logistic" (a plane between the classes), or "votes" (none: the detections alone
            decide).
        foreground: features of safe foreground points (at least 1).
        background: features of safe background points (at least 1).
        rng: chooses what is held out for calibration.
        gaussian_share: weight of a Gaussian per class beside the SVM, 0 for the SVM alone.
    """
    if name == "votes":
        return None
    if name == "svm":
        return train_mixed_classifier(foreground, background, rng, gaussian_share)
    held_front, front = _split(foreground, rng)
    held_back, back = _split(background, rng)
    rough = fit_plane(front, back)
    if not len(held_front) or not len(held_back):
        return fit_plane(foreground, background)
    checked = np.concatenate([held_front, held_back])
    positive = np.arange(len(checked)) < len(held_front)
    platt = fit_platt(rough.decision(checked).astype(float), positive)
    return Quadratic(rough.mean, rough.std, rough.matrix, rough.vector, rough.constant, platt)


def fit_plane(foreground: Float[np.ndarray, "f d"], background: Float[np.ndarray, "b d"]) -> Quadratic:
    """Logistic regression with a unit Gaussian prior on the weights, both classes counting the same."""
    mean, std = _standard(foreground, background)
    design = np.concatenate([(foreground - mean) / std, (background - mean) / std])
    design = np.concatenate([design, np.ones((len(design), 1))], axis=1)
    target = np.arange(len(design)) < len(foreground)
    balance = np.where(target, 0.5 / len(foreground), 0.5 / len(background)) * len(design)
    prior = np.eye(design.shape[1])
    prior[-1, -1] = 1e-6
    weights = np.zeros(design.shape[1])
    for _ in range(50):
        p = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        gradient = design.T @ (balance * (p - target)) + prior @ weights
        step = np.linalg.solve((design * (balance * p * (1 - p))[:, None]).T @ design + prior, gradient)
        weights -= step
        if np.abs(step).max() < 1e-7:
            break
    return Quadratic(mean, std, np.zeros((len(mean), len(mean))), weights[:-1], float(weights[-1]))


def _standard(foreground, background) -> tuple[Float64[np.ndarray, "d"], Float64[np.ndarray, "d"]]:
    features = np.concatenate([foreground, background]).astype(float)
    std = features.std(axis=0)
    return features.mean(axis=0), np.where(std > 1e-9, std, 1.0)


def _split(points, rng: np.random.Generator):
    """A fifth of the points, and the rest."""
    order = rng.permutation(len(points))
    return points[order[: len(points) // 5]], points[order[len(points) // 5 :]]
