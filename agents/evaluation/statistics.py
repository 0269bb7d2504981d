"""Means over seeds with their spread, and paired differences between policies on the same starts.

Starts in one scene are alike: what tells policies apart in one home may not do so in the next. So intervals are
bootstrapped over scenes, each with all its starts. Percentiles of so few numbers as there are scenes lie too close
together; they are moved apart as Student's distribution says. (To draw starts within the scenes that are drawn, too,
would count what differs between starts twice: of such intervals 98 to 99 in 100 hold the truth, with 20 to 40 scenes.)
"""

from collections.abc import Hashable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int64
from scipy.special import ndtri, stdtrit

from labeling.metrics.average_precision import mean_of

DIGITS = 5
RESAMPLES = 4000
MIN_EPISODES = 4
"""Fewer say nothing about how much episodes differ."""
MIN_SCENES = MIN_EPISODES
"""In fewer, nothing can be said about how much scenes differ: intervals are over starts, and of these scenes only."""
MIN_STARTS = 100
"""With fewer no difference counts as shown. As much as returns of the same start differ (a standard deviation of 3 with
means of 5), so many resolve a sixth of the mean."""
RESOLVED = 1.43
"""Times half the width of a 95 % interval: a difference whose interval excludes 0 four times out of five."""
QUANTILES = (0.025, 0.975)


def over_seeds(per_seed: Sequence[float | None]) -> dict[str, Any]:
    """Mean and sample standard deviation over seeds; the latter None with fewer than two."""
    defined = [value for value in per_seed if value is not None]
    std = float(np.std(defined, ddof=1)) if len(defined) > 1 else None
    return {"mean": rounded(mean_of(defined)), "std": rounded(std), "per_seed": [rounded(value) for value in per_seed]}


def paired_record(
    ours: Sequence[float | None], theirs: Sequence[float | None], scenes: Sequence[Hashable]
) -> dict[str, Any] | None:
    """Mean difference over starts with a 95 % interval over starts and scenes, as JSON; None if no start has both.

    Args:
        ours: a figure per start, None where it is undefined.
        theirs: the same figure of what is compared with, from the same starts.
        scenes: where each start is.

    Returns:
        ``mean``, ``low`` and ``high`` (None with too few starts), ``std`` (of the differences, None for one start),
        ``resolves`` (the difference that so many starts show four times out of five), ``episodes`` (starts on which
        both are defined), ``scenes`` (how many).
    """
    pairs = [(a - b, scene) for a, b, scene in zip(ours, theirs, scenes, strict=True) if None not in (a, b)]  # type: ignore[operator]
    if not pairs:
        return None
    values = np.array([value for value, _ in pairs])
    interval = mean_interval(values, [scene for _, scene in pairs])
    low, high = interval or (None, None)
    return {
        "mean": rounded(float(values.mean())),
        "low": rounded(low),
        "high": rounded(high),
        "std": rounded(float(values.std(ddof=1))) if len(values) > 1 else None,
        "resolves": rounded(RESOLVED * (high - low) / 2) if interval else None,  # type: ignore[operator]
        "episodes": len(values),
        "scenes": len({scene for _, scene in pairs}),
    }


def interval_record(values: Sequence[float | None], scenes: Sequence[Hashable]) -> dict[str, float | None]:
    """``low`` and ``high`` of the 95 % interval of a mean over starts and scenes, as JSON; None with too few starts.

    Args:
        values: a figure per start, None where it is undefined.
        scenes: where each start is.
    """
    there = [(value, scene) for value, scene in zip(values, scenes, strict=True) if value is not None]
    interval = mean_interval(np.array([value for value, _ in there], float), [scene for _, scene in there])
    return dict(zip(("low", "high"), map(rounded, interval or (None, None)), strict=True))


def mean_interval(
    values: Float[np.ndarray, "starts"], scenes: Sequence[Hashable], seed: int = 0
) -> tuple[float, float] | None:
    """Ends of the 95 % bootstrap interval of a mean over scenes with all their starts; over starts in few scenes.

    Args:
        values: one for each start.
        scenes: where each start is.
        seed: of the resampling.

    Returns:
        None with too few starts to say anything.

    Source:
        Davison and Hinkley, Bootstrap Methods and their Application, 1997, section 3.8 (whole groups are drawn).
    """
    if len(values) < MIN_EPISODES:
        return None
    numbers = {scene: number for number, scene in enumerate(dict.fromkeys(scenes))}
    over_scenes = len(numbers) >= MIN_SCENES
    places = np.array([numbers[scene] for scene in scenes]) if over_scenes else np.arange(len(values))
    sums, counts = np.bincount(places, values), np.bincount(places)
    groups, mean = len(sums), float(values.mean())
    drawn = _times_drawn(groups, seed)
    ends = np.quantile((drawn @ sums) / (drawn @ counts), QUANTILES)
    low, high = mean + (ends - mean) * small_sample_factor(groups)
    return float(low), float(high)


@lru_cache(maxsize=4)
def _times_drawn(groups: int, seed: int) -> Int64[np.ndarray, "resamples groups"]:
    """How often each group is in each resample."""
    return np.random.default_rng(seed).multinomial(groups, np.full(groups, 1 / groups), RESAMPLES)


def small_sample_factor(groups: int) -> float:
    """What the distance of percentiles from the mean is multiplied with, of so many groups; 1 of a single one."""
    if groups < 2:
        return 1.0
    return float(np.sqrt(groups / (groups - 1)) * stdtrit(groups - 1, QUANTILES[1]) / ndtri(QUANTILES[1]))


def significant_sign(difference: Mapping[str, Any]) -> int:
    """Which of two settings is significantly better, by their difference as JSON.

    Returns:
        1 if its interval lies above zero, -1 if below, 0 if neither, or if there is no interval.
    """
    if difference["low"] is None:
        return 0
    return int(difference["low"] > 0) - int(difference["high"] < 0)


def shown_sign(difference: Mapping[str, Any] | None) -> int:
    """Whether a paired difference is shown: 1 if it lies above 0, -1 if below, 0 if that cannot be said.

    Args:
        difference: as JSON. Its interval must exclude 0, over at least ``MIN_STARTS`` starts in ``MIN_SCENES`` scenes
            (records of before do not say in how many).
    """
    if difference is None or difference["episodes"] < MIN_STARTS or difference.get("scenes", 0) < MIN_SCENES:
        return 0
    return significant_sign(difference)


def starts_to_resolve(difference: dict[str, Any], target: float) -> int | None:
    """How many starts like these would show a difference as small as ``target``; None if that cannot be said."""
    if not difference["resolves"] or target <= 0.0:
        return None
    return int(np.ceil(difference["episodes"] * (difference["resolves"] / target) ** 2))


def rounded(value: float | None) -> float | None:
    """As it is written to JSON."""
    return None if value is None else round(float(value), DIGITS)
