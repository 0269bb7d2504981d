"""Signs that a robot has of its labels: a collapse is told from a trend, and never where labels only get better."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.loops.signs import TREND_ROUNDS, collapse_reason, label_statistics
from experiments.loops.signs import LabelStatistics as Statistics
from labeling.detectors.data.annotated_pictures import AnnotatedPicture, Annotation

STEADY = Statistics(3.0, 0.7, {"chair": 0.6, "table": 0.4})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: Statistics(0.0, 0.0, {}), "no labels"),
        (lambda s: Statistics(1.4, s.confidence, s.shares), "from 3.00 to 1.40"),
        (lambda s: Statistics(s.labels_per_view, 0.5, s.shares), "from 0.70 to 0.50"),
        (
            lambda s: Statistics(s.labels_per_view, s.confidence, {"chair": 0.9, "table": 0.1}),
            "90% of all labels are chair",
        ),
    ],
)
def test_each_way_to_collapse_is_named(change: Callable[[Statistics], Statistics], says: str) -> None:
    said = collapse_reason([STEADY] * TREND_ROUNDS + [change(STEADY)] * TREND_ROUNDS)
    assert said is not None
    assert says in said


def test_a_round_of_odd_homes_is_no_collapse_and_one_without_labels_is() -> None:
    odd = Statistics(1.2, 0.5, {"chair": 0.9, "table": 0.1})  # alone, each sign would be one
    rounds = [STEADY] * TREND_ROUNDS + [odd] + [STEADY] * TREND_ROUNDS
    assert [collapse_reason(rounds[: count + 1]) for count in range(len(rounds))] == [None] * len(rounds)
    said = collapse_reason([STEADY, Statistics(0.0, 0.0, {})])
    assert said is not None
    assert "no labels" in said


@given(st.integers(1, TREND_ROUNDS), st.floats(0.01, 5.0), st.floats(0.0, 1.0))
def test_too_few_rounds_show_no_trend(count: int, labels: float, confidence: float) -> None:
    assert collapse_reason([STEADY] * (count - 1) + [Statistics(labels, confidence, {"chair": 1.0})]) is None


def test_what_was_one_sided_from_the_start_is_no_collapse() -> None:
    streets = Statistics(3.0, 0.7, {"car": 0.95, "bus": 0.05})
    assert collapse_reason([streets] * (TREND_ROUNDS + 1)) is None


@given(st.lists(st.floats(0.5, 5.0), min_size=1, max_size=9), st.floats(0.0, 1.0))
def test_rounds_that_only_get_better_never_collapse(counts: list[float], confidence: float) -> None:
    rounds = [Statistics(count, confidence, STEADY.shares) for count in sorted(counts)]
    assert collapse_reason(rounds) is None


def picture(*labels: tuple[str, float, bool]) -> AnnotatedPicture:
    """Labels by category, weight, and whether they are regions to ignore."""
    annotations = tuple(Annotation(name, {}, weight, ignore) for name, weight, ignore in labels)
    return AnnotatedPicture(Path("view.png"), (4, 4), annotations)


def test_label_statistics_count_labels_and_leave_out_regions_to_ignore() -> None:
    found = label_statistics([picture(("chair", 0.8, False), ("table", 0.4, False), ("couch", 0.9, True)), picture()])
    assert found.labels_per_view == pytest.approx(1.0)
    assert found.confidence == pytest.approx(0.6)
    assert found.shares == {"chair": pytest.approx(0.5), "table": pytest.approx(0.5)}
