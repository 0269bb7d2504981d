"""Per-object classifiers on colour and position: an RBF support vector machine with calibrated probabilities."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64

from labeling.generator.segment.svm import decide, train_svm


@dataclass(frozen=True)
class SvmClassifier:
    """A trained classifier of one object."""

    mean: Float64[np.ndarray, "d"]
    std: Float64[np.ndarray, "d"]
    support: Float32[np.ndarray, "s d"]
    """Support vectors, standardised."""
    coefficient: Float32[np.ndarray, "s"]
    intercept: float
    gamma: float
    platt: tuple[float, float]
    """Slope and offset of the log-odds as a function of the decision value."""

    def log_odds(self, features: Float[np.ndarray, "n d"]) -> Float32[np.ndarray, "n"]:
        """Log-odds of the object at each row of features (same units as in training)."""
        scaled = (np.asarray(features, np.float32) - self.mean.astype(np.float32)) / self.std.astype(np.float32)
        decision = decide(scaled, self.support, self.coefficient, self.gamma, self.intercept)
        return (self.platt[0] * decision + self.platt[1]).astype(np.float32)


def train_svm_classifier(
    foreground: Float[np.ndarray, "f d"], background: Float[np.ndarray, "b d"], rng: np.random.Generator
) -> SvmClassifier:
    """Trains the classifier of one object.

    Args:
        foreground: features of safe foreground points (at least 1).
        background: features of safe background points (at least 1).
        rng: chooses the hold-out.

    Returns:
        An SVM with RBF kernel (C 1, gamma 1/d on standardised features) and a logistic map to log-odds, fitted on a
        hold-out of a fifth of the points.

    Source: thesis 4.3 (SVM on normalised colour and position); Platt, "Probabilistic Outputs for Support Vector
    Machines" (1999), whose targets keep a separable hold-out from giving certainty.
    """
    features = np.concatenate([foreground, background]).astype(float)
    labels = np.concatenate([np.ones(len(foreground)), np.zeros(len(background))])
    mean, std = features.mean(axis=0), features.std(axis=0)
    std = np.where(std > 1e-9, std, 1.0)
    features = (features - mean) / std
    held = np.zeros(len(labels), bool)
    for value in (0, 1):
        members = np.flatnonzero(labels == value)
        held[rng.permutation(members)[: len(members) // 5]] = True
    gamma = 1.0 / features.shape[1]
    support, coefficient, intercept = train_svm(features[~held], labels[~held] > 0, 1.0, gamma)
    if not held.any() or len(np.unique(labels[held])) < 2:
        platt = (2.0, 0.0)
    else:
        decision = decide(features[held].astype(np.float32), support, coefficient, gamma, intercept)
        platt = fit_platt(decision.astype(float), labels[held] > 0)
    return SvmClassifier(mean, std, support, coefficient, intercept, gamma, platt)


def fit_platt(decision: Float64[np.ndarray, "n"], positive: np.ndarray) -> tuple[float, float]:
    """Slope and offset of the logistic map from decision values to log-odds, by Newton's method. Source: Platt 1999."""
    count = np.count_nonzero(positive)
    target = np.where(positive, (count + 1) / (count + 2), 1 / (len(positive) - count + 2))
    slope, offset = 1.0, 0.0
    design = np.stack([decision, np.ones(len(decision))], axis=1)
    for _ in range(50):
        p = 1 / (1 + np.exp(-np.clip(slope * decision + offset, -30, 30)))
        gradient = design.T @ (p - target)
        hessian = (design * (p * (1 - p))[:, None]).T @ design + 1e-6 * np.eye(2)
        step = np.linalg.solve(hessian, gradient)
        step *= min(1.0, 5.0 / max(np.abs(step).max(), 1e-12))
        slope, offset = slope - step[0], offset - step[1]
        if np.abs(step).max() < 1e-7:
            break
    return float(max(slope, 0.0)), float(offset)
