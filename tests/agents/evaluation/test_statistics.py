"""Intervals over starts and scenes: against all resamples there are, SciPy, and the truth."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from agents.evaluation.statistics import (
    MIN_STARTS,
    RESOLVED,
    interval_record,
    mean_interval,
    paired_record,
    shown_sign,
    starts_to_resolve,
)

NUMBERS = st.floats(-50, 50).map(lambda value: round(value, 3))


def scaled(ends: np.ndarray, mean: float, groups: int) -> np.ndarray:
    """Moved apart from the mean as percentiles of few groups are."""
    student = stats.t.ppf(0.975, groups - 1) / stats.norm.ppf(0.975)
    return mean + (ends - mean) * student * (groups / (groups - 1)) ** 0.5


def test_all_resamples_of_scenes_with_their_starts():
    scenes = [[1.0, 2.0], [5.0], [0.0, 1.0, 0.5], [-2.0, 4.0], [3.0]]
    means = [np.mean(np.concatenate(drawn)) for drawn in itertools.product(scenes, repeat=len(scenes))]
    values = np.concatenate(scenes)
    wanted = scaled(np.quantile(means, [0.025, 0.975]), float(values.mean()), len(scenes))
    names = [name for name, values in enumerate(scenes) for _ in values]
    assert mean_interval(values, names) == pytest.approx(wanted, abs=0.15)


@pytest.mark.parametrize("count", [5, 12, 200])
def test_one_start_in_each_scene_is_as_student_has_it(count):
    values = np.random.default_rng(count).normal(3.0, 2.0, count)
    found = mean_interval(values, range(count))
    wanted = stats.ttest_1samp(values, 0.0).confidence_interval()
    assert found == pytest.approx((wanted.low, wanted.high), abs=0.12 * (wanted.high - wanted.low))


@given(st.lists(st.tuples(NUMBERS, st.integers(0, 7)), min_size=4, max_size=40), NUMBERS)
@settings(max_examples=60)
def test_what_is_added_moves_the_interval_and_a_sign_mirrors_it(starts, shift):
    values, scenes = np.array([value for value, _ in starts]), [scene for _, scene in starts]
    low, high = mean_interval(values, scenes) or (0.0, 0.0)
    assert low <= values.mean() + 1e-9
    assert high >= values.mean() - 1e-9
    assert mean_interval(values + shift, scenes) == pytest.approx((low + shift, high + shift), abs=1e-6)
    assert mean_interval(-values, scenes) == pytest.approx((-high, -low), abs=1e-6)


@given(st.lists(st.tuples(NUMBERS, st.integers(0, 7)), min_size=4, max_size=40), st.randoms(use_true_random=False))
@settings(max_examples=60)
def test_the_order_of_starts_within_scenes_changes_nothing(starts, random):
    by_scene = [[one for one in starts if one[1] == scene] for scene in dict.fromkeys(scene for _, scene in starts)]
    if len(by_scene) < 4:  # over starts, whose order the resampling knows
        return
    straight = [one for part in by_scene for one in part]
    for part in by_scene:
        random.shuffle(part)
    shuffled = [one for part in by_scene for one in part]
    found = [
        mean_interval(np.array([value for value, _ in some]), [scene for _, scene in some])
        for some in (straight, shuffled)
    ]
    assert found[0] == pytest.approx(found[1], abs=1e-9)


@pytest.mark.parametrize(("scenes", "starts", "scene_std"), [(20, 10, 1.0), (8, 5, 0.0), (40, 2, 0.5)])
def test_intervals_hold_the_truth_as_often_as_they_say(scenes, starts, scene_std):
    rng, trials, hits = np.random.default_rng(scenes), 400, 0
    names = np.repeat(np.arange(scenes), starts).tolist()
    for _ in range(trials):
        values = (scene_std * rng.normal(size=(scenes, 1)) + rng.normal(0.0, 2.0, (scenes, starts))).ravel()
        low, high = mean_interval(values, names) or (0.0, 0.0)
        hits += low <= 0.0 <= high
    assert 0.92 <= hits / trials <= 0.98


def test_a_difference_as_large_as_is_resolved_is_shown_four_times_out_of_five():
    rng, names = np.random.default_rng(1), np.repeat(np.arange(30), 10)
    truth, trials = 2.8 * 3.0 / 300**0.5, 400  # 1.96 + 0.84 standard errors
    records = [paired_record(rng.normal(truth, 3.0, 300).tolist(), [0.0] * 300, names.tolist()) for _ in range(trials)]
    assert np.mean([record["resolves"] for record in records if record]) == pytest.approx(truth, rel=0.1)
    assert 0.74 <= np.mean([shown_sign(record) for record in records]) <= 0.86
    errors = stats.norm.ppf(0.975), stats.norm.ppf(0.8)
    assert sum(errors) / errors[0] == pytest.approx(RESOLVED, abs=0.002)


def test_few_starts_or_few_scenes_show_nothing_however_far_apart():
    far = [10.0 + number % 3 for number in range(2 * MIN_STARTS)]
    nothing = [0.0] * len(far)
    spread = [number % 10 for number in range(len(far))]
    assert shown_sign(paired_record(far, nothing, spread)) == 1
    assert shown_sign(paired_record(nothing, far, spread)) == -1
    few = MIN_STARTS - 1
    assert shown_sign(paired_record(far[:few], nothing[:few], spread[:few])) == 0
    assert shown_sign(paired_record(far, nothing, [number % 3 for number in spread])) == 0
    assert shown_sign(paired_record(far, far[::-1], spread)) == 0
    assert shown_sign(None) == 0
    assert shown_sign({"mean": 1.0, "low": 0.5, "high": 1.5, "episodes": 500}) == 0


def test_records_by_hand():
    assert paired_record([1.0, None, 3.0], [0.0, 5.0, 1.0], "abc") == {
        "mean": 1.5,
        "low": None,
        "high": None,
        "std": pytest.approx(0.5**0.5, abs=1e-5),
        "resolves": None,
        "episodes": 2,
        "scenes": 2,
    }
    assert paired_record([None], [1.0], "a") is None
    same = paired_record([2.0] * 6, [1.0] * 6, "aabbcd")
    assert same is not None
    assert (same["mean"], same["low"], same["high"], same["std"], same["scenes"]) == (1.0, 1.0, 1.0, 0.0, 4)
    assert interval_record([2.0, 2.0, None, 2.0, 2.0], "abcde") == {"low": 2.0, "high": 2.0}
    assert interval_record([None, 1.0], "ab") == {"low": None, "high": None}


def test_starts_grow_with_the_square_of_how_fine_a_difference_is():
    record = {"resolves": 0.5, "episodes": 400}
    assert starts_to_resolve(record, 0.5) == 400
    assert starts_to_resolve(record, 0.25) == 1600
    assert starts_to_resolve(record, 0.0) is None
    assert starts_to_resolve({"resolves": None, "episodes": 2}, 1.0) is None
