"""Means over seeds with their spread, and paired differences between policies on the same episodes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

RESAMPLES = 4000
MIN_EPISODES = 4
"""Fewer say nothing about how much episodes differ."""
DIGITS = 5


def mean_of(values: Sequence[float | None]) -> float | None:
    """Mean of the defined values; None if there is none."""
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None


def over_seeds(per_seed: Sequence[float | None]) -> dict[str, Any]:
    """Mean and sample standard deviation over seeds; the latter None with fewer than two."""
    defined = [value for value in per_seed if value is not None]
    std = float(np.std(defined, ddof=1)) if len(defined) > 1 else None
    return {"mean": rounded(mean_of(defined)), "std": rounded(std), "per_seed": [rounded(value) for value in per_seed]}


def paired_difference(ours: Sequence[float | None], theirs: Sequence[float | None]) -> dict[str, Any] | None:
    """Mean difference over episodes with a 95 % percentile bootstrap interval; None if no episode has both.

    Args:
        ours: a figure per episode, None where it is undefined.
        theirs: the same figure of what is compared with, on the same episodes.

    Returns:
        ``mean``, ``low`` and ``high`` (None with too few episodes), ``episodes`` (on which both are defined).
    """
    differences = np.array([a - b for a, b in zip(ours, theirs, strict=True) if a is not None and b is not None])
    if len(differences) == 0:
        return None
    low = high = None
    if len(differences) >= MIN_EPISODES:
        drawn = np.random.default_rng(0).integers(len(differences), size=(RESAMPLES, len(differences)))
        low, high = (float(end) for end in np.quantile(differences[drawn].mean(axis=1), [0.025, 0.975]))
    mean = float(differences.mean())
    return {"mean": rounded(mean), "low": rounded(low), "high": rounded(high), "episodes": len(differences)}


def rounded(value: float | None) -> float | None:
    """As it is written to JSON."""
    return None if value is None else round(float(value), DIGITS)
