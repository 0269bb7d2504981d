"""Per-object classifiers on colour and position: an RBF support vector machine with calibrated probabilities."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64
from numba import njit, prange


@dataclass(frozen=True)
class Unary:
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
        scaled = np.ascontiguousarray((features - self.mean) / self.std, np.float32)
        decision = _decide(scaled, self.support, self.coefficient, np.float32(self.gamma), np.float32(self.intercept))
        return (self.platt[0] * decision + self.platt[1]).astype(np.float32)


def train_unary(
    foreground: Float[np.ndarray, "f d"], background: Float[np.ndarray, "b d"], rng: np.random.Generator
) -> Unary:
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
    from sklearn.svm import SVC

    features = np.concatenate([foreground, background]).astype(float)
    labels = np.concatenate([np.ones(len(foreground)), np.zeros(len(background))])
    mean, std = features.mean(axis=0), features.std(axis=0)
    std = np.where(std > 1e-9, std, 1.0)
    features = (features - mean) / std
    held = np.zeros(len(labels), bool)
    for value in (0, 1):
        members = np.flatnonzero(labels == value)
        held[rng.permutation(members)[: len(members) // 5]] = True
    machine = SVC(C=1.0, gamma=1.0 / features.shape[1])
    machine.fit(features[~held], labels[~held])
    coefficient = machine.dual_coef_.ravel().astype(np.float32)
    support = np.ascontiguousarray(machine.support_vectors_, np.float32)
    gamma, intercept = 1.0 / features.shape[1], float(machine.intercept_[0])
    if not held.any() or len(np.unique(labels[held])) < 2:
        platt = (2.0, 0.0)
    else:
        checked = np.ascontiguousarray(features[held], np.float32)
        decision = _decide(checked, support, coefficient, np.float32(gamma), np.float32(intercept))
        platt = fit_platt(decision.astype(float), labels[held] > 0)
    return Unary(mean, std, support, coefficient, intercept, gamma, platt)


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


@njit(cache=True, parallel=True)
def _decide(features, support, coefficient, gamma, intercept):  # pragma: no cover - compiled
    """Decision values of an RBF machine; every row is summed in one order, whatever the number of threads."""
    n, d = features.shape
    decision = np.empty(n, np.float32)
    for i in prange(n):
        total = intercept
        for s in range(len(coefficient)):
            square = np.float32(0.0)
            for j in range(d):
                difference = features[i, j] - support[s, j]
                square += difference * difference
            total += coefficient[s] * np.exp(-gamma * square)
        decision[i] = total
    return decision
