import numpy as np
import pytest

from labeling.metrics.average_precision import mean_of
from labeling.metrics.bootstrap import paired_difference


def test_paired_difference_is_of_pairs_and_its_interval_covers_the_truth() -> None:
    rng = np.random.default_rng(0)
    hits = 0
    for trial in range(60):
        level = rng.normal(0, 10, 30)  # episodes differ far more than settings
        ours, theirs = level + 0.5 + rng.normal(0, 1, 30), level + rng.normal(0, 1, 30)
        found = paired_difference(ours.tolist(), theirs.tolist(), trial)
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        assert found.mean == pytest.approx(np.mean(ours - theirs))
        assert found.low <= found.mean <= found.high
        assert found.high - found.low < 2
        hits += found.low <= 0.5 <= found.high
    assert hits >= 50


def test_undefined_figures_stay_out_of_pairs() -> None:
    found = paired_difference([1.0, None, 3.0], [0.5, 2.0, None])
    assert found is not None
    assert (found.mean, found.low, found.high, found.episodes) == (0.5, None, None, 1)
    assert paired_difference([None], [1.0]) is None
    assert mean_of([None, 1.0, 2.0]) == 1.5
    assert mean_of([None]) is None
