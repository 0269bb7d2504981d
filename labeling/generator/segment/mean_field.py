"""Mean-field inference in a fully connected CRF with Potts compatibility and Gaussian edge potentials.

Source: Kraehenbuehl and Koltun, "Efficient Inference in Fully Connected CRFs with Gaussian Edge Potentials" (2011);
thesis equation 4.1. The background's message follows from those of the objects (the filter is linear and the marginals
of a point sum to 1), so only the objects are filtered.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Float32, Int
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
    n, k = unary.shape
    terms = []
    for kernel in kernels:
        norm = _norm(kernel, n)
        everything = norm * kernel.filter.filter(norm[:, None])[:, 0]

        def messages(rows, kernel=kernel, norm=norm):
            return (norm[:, None] * kernel.filter.filter(norm[:, None] * rows.reshape(n, k))).ravel()

        terms.append(_Term(messages, np.repeat(everything, k), kernel.weight))
    rows = np.ascontiguousarray(unary, np.float32).ravel()
    return _iterate(rows, np.arange(n * k), np.arange(0, n * k + 1, max(k, 1)), terms, iterations, exclusive).reshape(
        n, k
    )


def mean_field_active(
    unary: Float32[np.ndarray, "m"],
    point: Int[np.ndarray, "m"],
    kernels: Sequence[Kernel],
    iterations: int,
    *,
    exclusive: bool = True,
) -> Float32[np.ndarray, "m"]:
    """Marginal probabilities where objects can be at all: ``mean_field`` with points left out of objects.

    Each row is one object at one point near it. Everything that is not a row is certain background; it is not part of
    the kernels either.

    Args:
        unary: log-odds of the row's object against the background, nats.
        point: which point a row speaks of; rows of one point share it.
        kernels: between rows of the same object, and 0 between others.
        iterations: mean-field updates.
        exclusive: whether the objects at a point share one unit of probability with the background.

    Returns:
        Probability of the row's object at its point.
    """
    terms = []
    for kernel in kernels:
        norm = _norm(kernel, len(unary))
        everything = norm * kernel.filter.filter(norm[:, None])[:, 0]

        def messages(rows, kernel=kernel, norm=norm):
            return norm * kernel.filter.filter((norm * rows)[:, None])[:, 0]

        terms.append(_Term(messages, everything, kernel.weight))
    order = np.argsort(point, kind="stable")
    first = np.flatnonzero(np.diff(point[order], prepend=-1))
    start = np.append(first, len(point))
    return _iterate(np.ascontiguousarray(unary, np.float32), order, start, terms, iterations, exclusive)


@dataclass(frozen=True)
class _Term:
    """A normalised kernel, acting on rows of one object and one point each."""

    messages: Callable[[Float32[np.ndarray, "m"]], Float32[np.ndarray, "m"]]
    everything: Float32[np.ndarray, "m"]
    """The message if all neighbours were certain."""
    weight: float


def _norm(kernel: Kernel, count: int) -> Float32[np.ndarray, "m"]:
    ones = np.ones((count, 1), np.float32)
    return 1.0 / np.sqrt(np.maximum(kernel.filter.filter(ones)[:, 0], np.float32(1e-20)))


def _iterate(unary, order, start, terms: Sequence[_Term], iterations: int, exclusive: bool):
    """Mean-field updates of rows; ``order[start[g]:start[g + 1]]`` are the rows of one point."""
    probability = _probabilities(unary, order, start, exclusive)
    for _ in range(iterations):
        energy = unary.copy()
        for term in terms:
            own = term.messages(probability)
            _add_message(energy, own, term.everything, order, start, np.float32(term.weight), exclusive)
        probability = _probabilities(energy, order, start, exclusive)
    return probability


@njit(cache=True, parallel=True)
def _add_message(energy, own, everything, order, start, weight, exclusive):  # pragma: no cover - compiled
    """Adds ``weight * (message of the object - message of the background)`` to the log-odds."""
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
    """Softmax over the objects and the background (log-odds 0), or a logistic function for each object alone."""
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


def log_odds(probability: Float[np.ndarray, "*shape"], clamp: float = 0.01) -> Float32[np.ndarray, "*shape"]:
    """``log(p / (1 - p))`` with probabilities held in [clamp, 1 - clamp]."""
    held = np.clip(probability, clamp, 1.0 - clamp)
    return np.log(held / (1.0 - held)).astype(np.float32)
