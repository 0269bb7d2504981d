"""Mean-field inference in a fully connected CRF with Potts compatibility and Gaussian edge potentials.

Source: Kraehenbuehl and Koltun, "Efficient Inference in Fully Connected CRFs with Gaussian Edge Potentials" (2011);
thesis equation 4.1. The background's message follows from those of the objects (the filter is linear and the marginals
of a point sum to 1), so only one channel per object is filtered.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Float32
from numba import njit, prange


class Filter(Protocol):
    """Anything that sums channels over points under a symmetric non-negative kernel: a lattice, or brute force."""

    def filter(self, values: Float32[np.ndarray, "n c"]) -> Float32[np.ndarray, "n c"]:
        """Kernel-weighted sums of the channels, the point itself included."""
        ...


@dataclass(frozen=True)
class Kernel:
    """One pairwise term: a filter and how much a unanimous neighbourhood counts, in nats."""

    filter: Filter
    weight: float


def mean_field(
    unary: Float32[np.ndarray, "n k"],
    kernels: Sequence[Kernel],
    iterations: int,
    *,
    exclusive: bool = True,
) -> Float32[np.ndarray, "n k"]:
    """Marginal probabilities of k objects at n points.

    Kernels are normalised symmetrically, ``D^-1/2 K D^-1/2``, so that a weight means the same in sparse and in dense
    places and for any number of points.

    Args:
        unary: log-odds of each object against the background, nats.
        kernels: the pairwise terms.
        iterations: mean-field updates; 0 gives the marginals of the unaries alone.
        exclusive: True for one multi-label CRF in which a point belongs to one object or to the background; False for
            one binary CRF per object (the thesis).

    Returns:
        Probability of each object at each point. With ``exclusive`` a row sums to at most 1.
    """
    unary = np.ascontiguousarray(unary, np.float32)
    prepared = []
    for kernel in kernels:
        ones = np.ones((len(unary), 1), np.float32)
        norm = 1.0 / np.sqrt(np.maximum(kernel.filter.filter(ones), np.float32(1e-20)))
        prepared.append((kernel, norm, norm * kernel.filter.filter(norm)))
    probability = _probabilities(unary, exclusive)
    for _ in range(iterations):
        energy = unary.copy()
        for kernel, norm, everything in prepared:
            message = kernel.filter.filter(norm * probability)
            _add_message(energy, message, norm, everything, np.float32(kernel.weight), exclusive)
        probability = _probabilities(energy, exclusive)
    return probability


@njit(cache=True, parallel=True)
def _add_message(energy, message, norm, everything, weight, exclusive):  # pragma: no cover - compiled
    """Adds ``weight * (message of the object - message of the background)`` to the log-odds."""
    n, k = energy.shape
    for i in prange(n):
        total = np.float32(0.0)
        if exclusive:
            for c in range(k):
                total += norm[i, 0] * message[i, c]
        for c in range(k):
            own = norm[i, 0] * message[i, c]
            background = everything[i, 0] - (total if exclusive else own)
            energy[i, c] += weight * (own - background)


@njit(cache=True, parallel=True)
def _probabilities(energy, exclusive):  # pragma: no cover - compiled
    """Softmax over the objects and the background (log-odds 0), or a logistic function for each object alone."""
    n, k = energy.shape
    probability = np.empty((n, k), np.float32)
    for i in prange(n):
        if exclusive:
            highest = np.float32(0.0)
            for c in range(k):
                highest = max(highest, energy[i, c])
            total = np.exp(-highest)
            for c in range(k):
                probability[i, c] = np.exp(energy[i, c] - highest)
                total += probability[i, c]
            for c in range(k):
                probability[i, c] /= total
        else:
            for c in range(k):
                probability[i, c] = np.float32(1.0) / (np.float32(1.0) + np.exp(-energy[i, c]))
    return probability


def log_odds(probability: Float[np.ndarray, "*shape"], clamp: float = 0.01) -> Float32[np.ndarray, "*shape"]:
    """``log(p / (1 - p))`` with probabilities held in [clamp, 1 - clamp]."""
    held = np.clip(probability, clamp, 1.0 - clamp)
    return np.log(held / (1.0 - held)).astype(np.float32)
