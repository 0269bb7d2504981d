"""Mean-field inference in a fully connected CRF with Potts compatibility and Gaussian edge potentials.

Source: Kraehenbuehl and Koltun, "Efficient Inference in Fully Connected CRFs with Gaussian Edge Potentials" (2011);
thesis equation 4.1. The background's message follows from those of the objects (the filter is linear and the marginals
of a point sum to 1), so only the objects are filtered.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float32, Int
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
    unary: Float32[np.ndarray, "m"],
    point: Int[np.ndarray, "m"],
    kernels: Sequence[Kernel],
    iterations: int,
    *,
    exclusive: bool = True,
) -> Float32[np.ndarray, "m"]:
    """Marginal probabilities of objects at points.

    Each row is one object at one point that it can reach. Everything that is not a row is certain background; it is not
    part of the kernels either. Kernels are normalised symmetrically, ``D^-1/2 K D^-1/2``, so that a weight means the
    same in sparse and in dense places and for any number of points.

    Args:
        unary: log-odds of the row's object against the background, nats.
        point: of each row; rows of one point share it.
        kernels: between rows of the same object, and 0 between others.
        iterations: mean-field updates; 0 gives the marginals of the unaries alone.
        exclusive: True for one multi-label CRF in which the objects at a point share one unit of probability with the
            background; False for one binary CRF per object (the thesis).

    Returns:
        Probability of the row's object at its point.
    """
    terms = []
    for kernel in kernels:
        degree = kernel.filter.filter(np.ones((len(unary), 1), np.float32))[:, 0]
        norm = 1.0 / np.sqrt(np.maximum(degree, np.float32(1e-20)))
        terms.append(_Term(kernel, norm, norm * kernel.filter.filter(norm[:, None])[:, 0]))
    order = np.argsort(point, kind="stable")
    first = np.flatnonzero(np.diff(point[order], prepend=-1))
    start = np.append(first, len(point))
    unary = np.ascontiguousarray(unary, np.float32)
    probability = _probabilities(unary, order, start, exclusive)
    for _ in range(iterations):
        energy = unary.copy()
        for term in terms:
            weight = np.float32(term.kernel.weight)
            _add_message(energy, term.messages(probability), term.everything, order, start, weight, exclusive)
        probability = _probabilities(energy, order, start, exclusive)
    return probability


@dataclass(frozen=True)
class _Term:
    """A normalised kernel, acting on rows of one object and one point each."""

    kernel: Kernel
    norm: Float32[np.ndarray, "m"]
    everything: Float32[np.ndarray, "m"]
    """The message if all neighbours were certain."""

    def messages(self, rows: Float32[np.ndarray, "m"]) -> Float32[np.ndarray, "m"]:
        """What the neighbours of each row say, from their probabilities."""
        return self.norm * self.kernel.filter.filter((self.norm * rows)[:, None])[:, 0]


@njit(cache=True, parallel=True)
def _add_message(energy, own, everything, order, start, weight, exclusive):  # pragma: no cover - compiled
    """Adds ``weight * (message of the object - message of the background)`` to the log-odds, in place.

    Args:
        energy: (m,) float32, log-odds of the rows.
        own: (m,) float32, messages of the rows' objects.
        everything: (m,) float32, messages if all neighbours were certain.
        order: (m,) int64, rows sorted by point.
        start: (points + 1,) int64, where the rows of each point start in ``order``.
        weight: of the kernel, float32.
        exclusive: whether the objects at a point share one unit of probability.
    """
    for group in prange(len(start) - 1):
        total = np.float32(0.0)
        for place in range(start[group], start[group + 1]):
            total += own[order[place]]
        for place in range(start[group], start[group + 1]):
            row = order[place]
            taken = total if exclusive else own[row]
            energy[row] += weight * (own[row] - (everything[row] - taken))


@njit(cache=True, parallel=True)
def _probabilities(energy, order, start, exclusive):  # pragma: no cover - compiled
    """Softmax over the objects and the background (log-odds 0), or a logistic function for each object alone.

    Args:
        energy: (m,) float32, log-odds of the rows.
        order: (m,) int64, rows sorted by point.
        start: (points + 1,) int64, where the rows of each point start in ``order``.
        exclusive: which of the two.

    Returns:
        (m,) float32.
    """
    probability = np.empty(len(energy), np.float32)
    for group in prange(len(start) - 1):
        highest, total = np.float32(0.0), np.float32(0.0)
        if exclusive:
            for place in range(start[group], start[group + 1]):
                highest = max(highest, energy[order[place]])
            total = np.exp(-highest)
            for place in range(start[group], start[group + 1]):
                total += np.exp(energy[order[place]] - highest)
        for place in range(start[group], start[group + 1]):
            row = order[place]
            if exclusive:
                probability[row] = np.exp(energy[row] - highest) / total
            else:
                probability[row] = np.float32(1.0) / (np.float32(1.0) + np.exp(-energy[row]))
    return probability
