"""Kinds of errors and the numbers behind the charts, on masks whose answers can be counted by hand."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.rle import encode_mask
from labeling.evaluation.compare import evaluate_label_set
from labeling.evaluation.report.by_confidence import BACKGROUND, by_confidence
from labeling.evaluation.report.errors import KINDS, kinds_of
from labeling.evaluation.report.statistics import statistics_of
from labeling.metrics.mask_ap import average_precision, precision_curves
from labeling.metrics.matching import MaskInstance, match


def strip(category: str, start: int, end: int, confidence: float = 1.0, ignore: bool = False) -> MaskInstance:
    mask = np.zeros((4, 40), bool)
    mask[:, start:end] = True
    return MaskInstance(("one", 0), category, encode_mask(mask), confidence, ignore)


TRUTHS = [strip("chair", 0, 10), strip("table", 20, 30), strip("plant", 34, 40, ignore=True)]


@pytest.mark.parametrize(
    ("predicted", "kind"),
    [
        (strip("chair", 0, 9), "right"),
        (strip("chair", 0, 4), "localisation"),
        (strip("chair", 20, 30), "classification"),
        (strip("chair", 12, 18), "background"),
        (strip("plant", 34, 40), "ignored"),
        (strip("chair", 34, 40), "ignored"),
    ],
)
def test_one_prediction_has_one_kind(predicted: MaskInstance, kind: str) -> None:
    assert kinds_of([predicted], TRUTHS, match([predicted], TRUTHS)) == [kind]


def test_what_lies_in_a_large_region_to_ignore_is_no_phantom() -> None:
    """By IoU it is not near the region, of which it covers a twelfth; average precision leaves it out all the same."""
    crowd = [strip("chair", 0, 36, ignore=True), strip("table", 37, 40)]
    inside, other, half_out = strip("chair", 4, 7), strip("table", 4, 7), strip("chair", 35, 38)
    for one, kind in ((inside, "ignored"), (other, "background"), (half_out, "background")):
        assert kinds_of([one], crowd, match([one], crowd)) == [kind]
        phantoms = by_confidence([one], crowd).confusion[BACKGROUND, one.category][0]
        assert phantoms == (kind == "background")
    assert average_precision([strip("table", 37, 40), inside], crowd, (0.5,)).mean[0.5] == pytest.approx(1.0)


def test_the_second_of_an_object_is_a_duplicate() -> None:
    both = [strip("chair", 0, 10), strip("chair", 0, 9)]
    assert kinds_of(both, TRUTHS, match(both, TRUTHS)) == ["right", "duplicate"]


def test_without_ground_truth_all_is_background() -> None:
    assert kinds_of([strip("chair", 0, 9)], [], []) == ["background"]


def test_the_mean_of_a_curve_is_the_average_precision() -> None:
    predictions = [strip("chair", 12, 18, 0.9), strip("chair", 0, 9, 0.8), strip("sofa", 0, 3, 0.7)]
    curves = precision_curves(predictions, TRUTHS)
    assert set(curves) == {"chair", "table"}
    ap = average_precision(predictions, TRUTHS, (0.5,)).per_class
    assert {name: pytest.approx(float(np.mean(curve))) for name, curve in curves.items()} == {
        name: ap[name][0.5] for name in curves
    }


def test_numbers_of_a_label_set_add_up(scene) -> None:
    scene.add_episode("one")
    scene.write_labels(lambda truth: ("sofa" if truth.category == "chair" else truth.category, 0.7, truth.modal))
    found = statistics_of(evaluate_label_set(scene.labels))
    detector, labels = found["detector"], found["labels"]
    assert detector is not None
    assert labels is not None
    assert set(labels.kinds) == set(KINDS)
    assert labels.kinds["right"] == labels.kinds["classification"] == labels.kinds["missed"] == 2
    assert sum(labels.iou_counts) == 4
    assert labels.confusion == {"chair": {"sofa": 2}, "plant": {"plant": 2}}
    assert labels.reliability[7] == (4, pytest.approx(0.5))
    assert sum(count for count, _ in labels.reliability) == 4
    assert labels.phantoms == []
    assert BACKGROUND not in labels.confusion
    assert [item.confidence for item in detector.phantoms] == sorted(
        (item.confidence for item in detector.phantoms), reverse=True
    )


def test_a_detector_that_never_looked_has_no_numbers(scene) -> None:
    scene.add_episode("one", detections=None)
    scene.write_labels()
    assert statistics_of(evaluate_label_set(scene.labels))["detector"] is None


CONFIDENCES = st.one_of(st.floats(0, 1), st.integers(0, 100).map(lambda step: step / 100))


@st.composite
def pictures(draw: st.DrawFn) -> tuple[list[MaskInstance], list[MaskInstance]]:
    """Predictions and truths of two pictures, of two categories."""

    def some(most: int, truth: bool) -> list[MaskInstance]:
        found = []
        for _ in range(draw(st.integers(0, most))):
            start, length = draw(st.integers(0, 30)), draw(st.integers(1, 9))
            confidence, ignore = (1.0, draw(st.booleans())) if truth else (draw(CONFIDENCES), False)
            one = strip(draw(st.sampled_from(["chair", "table"])), start, start + length, confidence, ignore)
            found.append(replace(one, image=("one", draw(st.integers(0, 1)))))
        return found

    return some(6, False), some(4, True)


@settings(max_examples=60)
@given(pictures(), st.integers(0, 100))
def test_counts_at_a_confidence_are_those_of_the_predictions_that_have_it(both, step: int) -> None:
    """Against kinds and matches of those predictions alone."""
    predictions, truths = both
    at = by_confidence(predictions, truths)
    kept = [item for item in predictions if item.confidence >= step / 100]
    matches = match(kept, truths)
    expected = Counter(zip((item.category for item in kept), kinds_of(kept, truths, matches), strict=True))
    counted = [found for found in matches if not truths[found.truth].ignore]
    expected.update((truths[found.truth].category, "missed") for found in counted if found.iou < 0.5)
    assert {key: n[step] for key, n in at.kinds.items() if n[step]} == dict(expected)
    sums = {name: sum(one.iou for one in counted if truths[one.truth].category == name) for name in at.iou_sum}
    assert {name: value[step] for name, value in at.iou_sum.items()} == pytest.approx(sums)
    assert sum(n[step] for n in at.ious.values()) == len(counted)
    shown = [n[step] for (true, _), n in at.confusion.items() if true != BACKGROUND]
    assert sum(shown) == len(counted)  # every instance is called something, or missed


def test_what_takes_the_place_of_a_less_sure_outline_is_right() -> None:
    """The best outline is not the surest: without it the second stands for the object."""
    at = by_confidence([strip("chair", 0, 10, 0.3), strip("chair", 0, 7, 0.8)], TRUTHS)
    assert [(at.kinds["chair", "right"][step], at.kinds["chair", "duplicate"][step]) for step in (30, 31, 81)] == [
        (1, 1),
        (1, 0),
        (0, 0),
    ]
    assert [at.kinds["chair", "missed"][step] for step in (30, 31, 80, 81)] == [0, 0, 0, 1]
    assert [at.ious["chair", 7][step] for step in (30, 31, 80, 81)] == [0, 1, 1, 0]
