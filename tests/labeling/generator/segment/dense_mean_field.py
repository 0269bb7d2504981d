"""Mean field with every object at every point, and log-odds: what the tests of the CRF compare with."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from labeling.generator.segment.active_points import ActivePoints
from labeling.generator.segment.mean_field import Filter, Kernel


@dataclass(frozen=True)
class ForEveryObject:
    """A filter over points that works on rows: object after object, each at all points."""

    over_points: Filter
    objects: int

    def filter(self, values: np.ndarray) -> np.ndarray:
        columns = np.ascontiguousarray(values.reshape(self.objects, -1).T)
        return self.over_points.filter(columns).T.reshape(-1, 1)


def mean_field(unary: np.ndarray, kernels: Sequence[Kernel], iterations: int, exclusive: bool = True) -> np.ndarray:
    """Marginals (n, k) of all objects at all points; kernels filter points."""
    active = ActivePoints.of(np.ones(unary.shape, bool))
    rows = [Kernel(ForEveryObject(kernel.filter, unary.shape[1]), kernel.weight) for kernel in kernels]
    return active.marginals(unary, rows, iterations, exclusive)


def log_odds(probability: np.ndarray, clamp: float = 0.01) -> np.ndarray:
    """``log(p / (1 - p))`` with probabilities held in [clamp, 1 - clamp]."""
    held = np.clip(probability, clamp, 1.0 - clamp)
    return np.log(held / (1.0 - held)).astype(np.float32)
