"""Kinds of errors and the numbers behind the charts, on masks whose answers can be counted by hand."""

import numpy as np
import pytest

from labeling.core.rle import encode_mask
from labeling.evaluation.compare import evaluate_label_set
from labeling.evaluation.report.errors import KINDS, kinds_of
from labeling.evaluation.report.statistics import BACKGROUND, statistics_of
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
