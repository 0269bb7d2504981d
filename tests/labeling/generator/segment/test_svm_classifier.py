import numpy as np
import pytest

from labeling.generator.segment.svm_classifier import fit_platt, train_svm_classifier


def two_crowds(seed: int, apart: float, count: int = 300):
    rng = np.random.default_rng(seed)
    return rng.normal(apart, 1, (count, 6)) * [1, 5, 0.1, 1, 1, 1], rng.normal(0, 1, (count, 6)) * [1, 5, 0.1, 1, 1, 1]


def test_decisions_are_those_of_the_library() -> None:
    from sklearn.svm import SVC

    front, back = two_crowds(0, 1.0)
    unary = train_svm_classifier(front, back, np.random.default_rng(0))
    features = np.concatenate([front, back])
    scaled = (features - features.mean(axis=0)) / features.std(axis=0)
    held = np.zeros(600, bool)
    rng = np.random.default_rng(0)
    for members in (np.arange(300, 600), np.arange(300)):
        held[rng.permutation(members)[:60]] = True
    machine = SVC(C=1.0, gamma="auto").fit(scaled[~held], (np.arange(600) < 300)[~held].astype(float))
    decision = machine.decision_function(scaled)
    expected = unary.platt[0] * decision + unary.platt[1]
    # Both stop where no optimality condition is violated by more than 1e-3.
    np.testing.assert_allclose(unary.log_odds(features), expected, atol=1e-2)


def test_probabilities_are_calibrated_on_new_points() -> None:
    front, back = two_crowds(1, 0.5, 400)
    unary = train_svm_classifier(front, back, np.random.default_rng(1))
    new_front, new_back = two_crowds(2, 0.5, 4000)
    probability = 1 / (1 + np.exp(-unary.log_odds(np.concatenate([new_front, new_back]))))
    truth = np.arange(8000) < 4000
    for low, high in ((0.1, 0.3), (0.4, 0.6), (0.7, 0.9)):
        inside = (probability > low) & (probability <= high)
        assert np.mean(truth[inside]) == pytest.approx(np.mean(probability[inside]), abs=0.12)


def test_platt_finds_the_slope_that_made_the_labels() -> None:
    rng = np.random.default_rng(3)
    decision = rng.normal(0, 2, 20000)
    positive = rng.random(20000) < 1 / (1 + np.exp(-(1.5 * decision - 0.7)))
    np.testing.assert_allclose(fit_platt(decision, positive), (1.5, -0.7), atol=0.08)


def test_platt_is_not_certain_of_a_separable_hold_out() -> None:
    slope, offset = fit_platt(np.array([-1.0] * 30 + [1.0] * 30), np.array([False] * 30 + [True] * 30))
    assert 1 / (1 + np.exp(-(slope + offset))) == pytest.approx(31 / 32, abs=1e-3)


def test_one_point_of_each_class_is_enough() -> None:
    unary = train_svm_classifier(np.ones((1, 6)), np.zeros((1, 6)), np.random.default_rng(0))
    inside, outside = unary.log_odds(np.array([[1.0] * 6, [0.0] * 6]))
    assert inside > outside


def test_same_generator_same_classifier() -> None:
    front, back = two_crowds(4, 1.0)
    results = [train_svm_classifier(front, back, np.random.default_rng(7)).log_odds(back) for _ in range(2)]
    np.testing.assert_array_equal(results[0], results[1])
