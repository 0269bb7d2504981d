import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection, PseudoLabel
from labeling.generator.calibration.detector_calibration import FOLDER, calibration_of
from labeling.generator.quality.label_quality import FEATURES, LabelQualityModel, fit_model, label_features
from labeling.metrics.calibration_error import calibration_curve

NAMES = list(FEATURES)


def chairs(rows: np.ndarray) -> list[str]:
    """Categories of labels that are all chairs."""
    return ["chair"] * len(rows)


def label(view: int, category: str = "chair", side: int = 10, left: int = 5, instance_id: int = 1) -> PseudoLabel:
    mask = np.zeros((40, 60), bool)
    mask[10 : 10 + side, left : left + side] = True
    return PseudoLabel(view, instance_id, category, 0.5, mask, mask, 0, 0.9)


def feature(rows: np.ndarray, name: str) -> np.ndarray:
    return rows[:, NAMES.index(name)]


def seen(one: PseudoLabel, confidence: float, category: str = "chair") -> Detection:
    return Detection(one.view_index, category, confidence, one.modal)


def test_views_where_the_detector_finds_nothing_count_against_an_object() -> None:
    labels = [label(view) for view in range(4)]
    all_views = label_features(labels, [0.5] * 4, [0.9] * 4, [seen(one, 0.8) for one in labels])
    one_view = label_features(labels, [0.5] * 4, [0.9] * 4, [seen(labels[0], 0.8)])
    assert np.allclose(feature(all_views, "agreement"), 0.8, atol=1e-4)
    assert np.allclose(feature(one_view, "agreement"), 0.2, atol=1e-4)
    assert np.allclose(feature(one_view, "agreeing_views"), 1)
    assert np.allclose(feature(one_view, "best_detection"), feature(all_views, "best_detection"))
    assert feature(one_view, "own_detection").tolist() == pytest.approx([0.8, 0, 0, 0])


def test_another_name_contradicts_and_another_place_says_nothing() -> None:
    labels = [label(0), label(1)]
    rows = label_features(labels, [0.5, 0.5], [0.9, 0.9], [seen(labels[0], 0.6, "bed"), seen(label(1, left=40), 0.9)])
    assert np.allclose(feature(rows, "contradiction"), 0.3, atol=1e-4)
    assert np.allclose(feature(rows, "agreement"), 0)


def test_a_view_of_a_sliver_counts_less_than_a_view_from_near() -> None:
    labels = [label(0, side=20), label(1, side=5)]
    near = label_features(labels, [0.5, 0.5], [0.9, 0.9], [seen(labels[0], 0.8)])
    far = label_features(labels, [0.5, 0.5], [0.9, 0.9], [seen(labels[1], 0.8)])
    assert np.allclose(feature(near, "agreement"), 0.64, atol=1e-3)
    assert np.allclose(feature(far, "agreement"), 0.16, atol=1e-3)


@settings(max_examples=30)
@given(st.integers(0, 10_000))
def test_the_order_of_the_detections_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    labels = [label(int(v), left=int(x), instance_id=k) for k, (v, x) in enumerate(rng.integers(0, 3, (5, 2)), 1)]
    found = [seen(labels[i], float(rng.random()), str(rng.choice(["chair", "bed"]))) for i in rng.integers(0, 5, 8)]
    order = rng.permutation(len(found))
    sure = rng.random(5).tolist()
    assert np.allclose(
        label_features(labels, sure, sure, found), label_features(labels, sure, sure, [found[i] for i in order])
    )


def test_a_fit_recovers_the_model_that_made_the_data() -> None:
    rng = np.random.default_rng(0)
    features = rng.uniform(-3, 5, (6000, len(NAMES)))
    knots = np.tile([-3.0, -1 / 3, 7 / 3, 5.0], (len(NAMES), 1))  # quantiles of what is drawn
    true = LabelQualityModel(knots, rng.uniform(0, 0.6, (len(NAMES), 3)), -4.0)
    chance = true.expected_iou(features, chairs(features))
    assert chance.min() < 0.1 < 0.7 < chance.max()
    fitted = fit_model(features, chance, chairs(features), ridge=0.0)
    assert np.allclose(fitted.knots, knots, atol=0.15)
    assert np.abs(fitted.expected_iou(features, chairs(features)) - chance).max() < 0.02


def test_an_effect_that_bends_is_followed() -> None:
    """Labels are worth something only where the posterior is high: a line would be wrong by .036 on average."""
    features = np.random.default_rng(2).normal(0, 1, (4000, len(NAMES)))
    gain = np.zeros((len(NAMES), 3))
    gain[NAMES.index("posterior"), 2] = 8.0
    knots = np.quantile(features, [0, 1 / 3, 2 / 3, 1], axis=0).T
    outcome = LabelQualityModel(knots, gain, -3.0).expected_iou(features, chairs(features))
    model = fit_model(features, outcome, chairs(features))
    curve = calibration_curve(model.expected_iou(features, chairs(features)), outcome)
    assert curve is not None
    assert curve.expected_calibration_error < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_no_feature_can_count_the_wrong_way(name: str) -> None:
    """Whatever the data say, more agreement never makes a label less trusted."""
    rng = np.random.default_rng(1)
    features = rng.normal(0, 1, (300, len(NAMES)))
    column = NAMES.index(name)
    outcome = (features[:, column] * FEATURES[name] < 0).astype(float)
    fitted = fit_model(features, outcome, rng.choice(["chair", "bed"], len(features)).tolist())
    assert np.all(fitted.gain[column] == 0)
    assert np.all(fitted.gain >= 0)
    assert all(scale >= 0 for scale, _ in fitted.lines.values())


def test_what_is_said_of_a_category_counts_as_it_turned_out() -> None:
    """Of chairs only what is very sure is right, of beds more is than it seems; of a category that is hardly seen one
    knows no more than of all.
    """
    rng = np.random.default_rng(4)
    features = rng.normal(0, 1, (6000, len(NAMES)))
    categories = np.where(rng.random(6000) < 0.5, "chair", "bed")
    categories[:5] = "toilet"
    odds = 2 * np.clip(features[:, NAMES.index("posterior")], -2, 2)
    outcome = 1 / (1 + np.exp(-np.where(categories == "chair", 2 * odds - 3, 0.7 * odds + 1)))
    model = fit_model(features, outcome, categories.tolist())
    assert set(model.lines) == {"chair", "bed"}
    found = model.expected_iou(features, categories.tolist())
    for name in ("chair", "bed"):
        own = categories == name
        assert np.mean(found[own]) == pytest.approx(np.mean(outcome[own]), abs=0.01)
        assert np.sqrt(np.mean((found - outcome)[own] ** 2)) < 0.05
    unknown = replace(model, lines={}).expected_iou(features, ["bed"] * 6000)
    np.testing.assert_array_equal(model.expected_iou(features, ["toilet"] * 6000), unknown)
    assert np.sqrt(np.mean((unknown - outcome) ** 2)) > 0.15


def test_lines_of_few_labels_stay_near_the_common_one() -> None:
    rng = np.random.default_rng(5)
    features = rng.normal(0, 1, (4000, len(NAMES)))
    categories = np.array(["bed"] * 3975 + ["chair"] * 25)
    outcome = np.where(categories == "chair", 0.0, 0.9)
    lines = fit_model(features, outcome, categories.tolist()).lines
    assert 0 < -lines["chair"][1] < 4
    assert np.abs(lines["bed"] - [1, 0]).max() < 0.2


def test_a_detector_without_a_calibration_gets_no_lines_of_another() -> None:
    assert calibration_of("some other").labels.lines == {}


@settings(max_examples=50)
@given(st.integers(0, 10_000), st.integers(0, len(NAMES) - 1), st.floats(0, 30))
def test_more_of_what_speaks_for_a_label_never_lowers_it(seed: int, column: int, more: float) -> None:
    rng = np.random.default_rng(seed)
    knots = np.cumsum(rng.uniform(0.1, 2, (len(NAMES), 4)), axis=1)
    lines = {"bed": np.array([rng.uniform(0, 3), rng.normal()])}
    model = LabelQualityModel(knots, rng.uniform(0, 3, (len(NAMES), 3)), float(rng.normal()), lines)
    features, categories = rng.normal(2, 4, (20, len(NAMES))), rng.choice(["chair", "bed"], 20).tolist()
    moved = features.copy()
    moved[:, column] += more * FEATURES[NAMES[column]]
    assert np.all(model.expected_iou(moved, categories) >= model.expected_iou(features, categories) - 1e-12)


def test_a_feature_that_is_the_same_in_all_labels_has_no_effect() -> None:
    rng = np.random.default_rng(3)
    features = rng.normal(0, 1, (200, len(NAMES)))
    features[:, 4] = 0.0
    model = fit_model(features, rng.uniform(0, 1, 200), chairs(features))
    assert np.all(np.diff(model.knots, axis=1) > 0)
    assert np.all(model.gain[4] == 0)


def test_a_feature_that_is_next_to_the_same_in_most_labels_survives_its_file() -> None:
    rng = np.random.default_rng(4)
    features = rng.normal(0, 1, (300, len(NAMES)))
    features[:, -1] = np.where(rng.uniform(size=300) < 0.6, 1 - rng.choice([0, 1e-9, 1e-8], 300), rng.uniform(size=300))
    outcome = rng.uniform(0, 1, 300)
    fitted = replace(calibration_of(), labels=fit_model(features, outcome, chairs(features)))
    read = np.array(fitted.as_json()["labels"]["knots"])
    assert np.all(np.diff(read, axis=1) > 0)
    again = replace(fitted.labels, knots=read).expected_iou(features, chairs(features))
    np.testing.assert_allclose(again, fitted.labels.expected_iou(features, chairs(features)), atol=1e-3)


@pytest.mark.parametrize("detector", ["compact", "simulated"])
def test_the_models_that_are_shipped_are_monotone_and_say_where_they_come_from(detector: str) -> None:
    model = calibration_of(detector).labels
    assert np.all(np.diff(model.knots, axis=1) > 0)
    assert np.all(model.gain >= 0)
    assert model.gain[NAMES.index("posterior")].sum() > 0
    about = json.loads((FOLDER / f"{detector}.json").read_text())["fitted_to"]
    assert about["labels"] > 500
    assert all(("endless" in origin or "seed/" in origin) and detector in origin for origin in about["episodes"])


def test_no_labels_have_no_features() -> None:
    none = label_features([], [], [], [])
    assert none.shape == (0, len(NAMES))
    assert calibration_of("compact").labels.expected_iou(none, []).shape == (0,)


def test_a_hidden_object_has_finite_features() -> None:
    hidden = replace(label(0), modal=np.zeros((40, 60), bool))
    rows = label_features([hidden], [0.5], [0.9], [seen(label(0), 0.8)])
    assert np.isfinite(rows).all()
    assert feature(rows, "visible_share")[0] == 0
