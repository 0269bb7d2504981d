"""Paired bootstrap: two settings compared on the same episodes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

RESAMPLES = 4000
MIN_EPISODES = 4
"""Fewer say nothing about how much episodes differ."""


@dataclass(frozen=True)
class Difference:
    """How much better one setting is than another."""

    mean: float
    low: float | None
    """Lower end of the 95 % bootstrap interval of the mean over episodes; None with too few of them."""
    high: float | None
    episodes: int
    """On how many episodes both are defined."""


def paired_difference(ours: Sequence[float | None], theirs: Sequence[float | None], seed: int = 0) -> Difference | None:
    """Mean difference over episodes with a percentile bootstrap interval; None if no episode has both.

    Args:
        ours: a figure per episode, None where it is undefined.
        theirs: the same figure of what is compared with, on the same episodes.
        seed: of the resampling.
    """
    pairs = [(a, b) for a, b in zip(ours, theirs, strict=True) if a is not None and b is not None]
    if not pairs:
        return None
    differences = np.array([a - b for a, b in pairs])
    mean, count = float(differences.mean()), len(differences)
    if count < MIN_EPISODES:
        return Difference(mean, None, None, count)
    drawn = np.random.default_rng(seed).integers(count, size=(RESAMPLES, count))
    low, high = np.quantile(differences[drawn].mean(axis=1), [0.025, 0.975])
    return Difference(mean, float(low), float(high), count)


def significant_sign(difference: dict[str, Any]) -> int:
    """Which of two settings is significantly better, by their difference as JSON.

    Returns:
        1 if its interval lies above zero, -1 if below, 0 if neither, or if there is no interval.
    """
    if difference["low"] is None:
        return 0
    return int(difference["low"] > 0) - int(difference["high"] < 0)
