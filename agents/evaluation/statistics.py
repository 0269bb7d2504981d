"""Means over seeds with their spread, and paired differences between policies on the same episodes."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from labeling.metrics.average_precision import mean_of
from labeling.metrics.bootstrap import paired_difference

DIGITS = 5


def over_seeds(per_seed: Sequence[float | None]) -> dict[str, Any]:
    """Mean and sample standard deviation over seeds; the latter None with fewer than two."""
    defined = [value for value in per_seed if value is not None]
    std = float(np.std(defined, ddof=1)) if len(defined) > 1 else None
    return {"mean": rounded(mean_of(defined)), "std": rounded(std), "per_seed": [rounded(value) for value in per_seed]}


def difference_record(ours: Sequence[float | None], theirs: Sequence[float | None]) -> dict[str, Any] | None:
    """Mean difference over episodes with a 95 % bootstrap interval, as JSON; None if no episode has both.

    Args:
        ours: a figure per episode, None where it is undefined.
        theirs: the same figure of what is compared with, on the same episodes.

    Returns:
        ``mean``, ``low`` and ``high`` (None with too few episodes), ``episodes`` (on which both are defined).
    """
    difference = paired_difference(ours, theirs)
    if difference is None:
        return None
    return {name: value if name == "episodes" else rounded(value) for name, value in asdict(difference).items()}


def rounded(value: float | None) -> float | None:
    """As it is written to JSON."""
    return None if value is None else round(float(value), DIGITS)
