import numpy as np
import pytest

from labeling.generator.segment.svm import decide, train_svm


def crowds(seed: int, apart: float = 0.8, count: int = 150) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    features = np.concatenate([rng.normal(size=(count, 6)), rng.normal(size=(count, 6)) + rng.normal(0, apart, 6)])
    return features.astype(np.float32), np.arange(2 * count) < count


@pytest.mark.parametrize(("seed", "apart", "c"), [(0, 0.3, 1.0), (1, 0.8, 1.0), (2, 5.0, 1.0), (3, 0.8, 100.0)])
def test_decisions_are_those_of_the_library(seed: int, apart: float, c: float) -> None:
    from sklearn.svm import SVC

    features, positive = crowds(seed, apart)
    machine = SVC(C=c, gamma=0.2, tol=1e-5).fit(features, positive)  # pyright: ignore[reportArgumentType]
    support, coefficient, intercept = train_svm(features, positive, c, 0.2, tolerance=1e-5)
    new = crowds(seed + 100)[0]
    np.testing.assert_allclose(
        decide(new, support, coefficient, 0.2, intercept), machine.decision_function(new), atol=2e-3
    )


def test_coefficients_meet_the_conditions_of_the_optimum() -> None:
    features, positive = crowds(4)
    support, coefficient, intercept = train_svm(features, positive, 1.0, 0.2)
    assert abs(coefficient.sum()) < 1e-4
    assert np.abs(coefficient).max() <= 1.0
    margin = np.where(positive, 1, -1) * decide(features, support, coefficient, 0.2, intercept)
    used = (features[:, None] == support[None]).all(axis=2).any(axis=1)
    assert margin[~used].min() >= 1 - 2e-3
    bound = np.zeros(len(features), bool)
    bound[used] = np.abs(coefficient) >= 1.0
    assert margin[bound].max() <= 1 + 2e-3
    np.testing.assert_allclose(margin[used & ~bound], 1.0, atol=2e-3)


def test_decisions_are_sums_of_gaussians_near_and_far() -> None:
    rng = np.random.default_rng(5)
    support, coefficient = rng.normal(size=(40, 6)).astype(np.float32), rng.normal(size=40).astype(np.float32)
    features = np.concatenate([support, rng.normal(size=(1000, 6)), 1000 * rng.normal(size=(7, 6))]).astype(np.float32)
    square = ((features[:, None].astype(float) - support[None]) ** 2).sum(axis=2)
    expected = np.exp(-0.7 * square) @ coefficient.astype(float) + 0.25
    np.testing.assert_allclose(decide(features, support, coefficient, 0.7, 0.25), expected, rtol=1e-5, atol=3e-6)


def test_one_point_of_each_class_is_enough() -> None:
    features = np.array([[0.0, 0.0], [1.0, 1.0]], np.float32)
    support, coefficient, intercept = train_svm(features, np.array([True, False]), 1.0, 0.5)
    first, second = decide(features, support, coefficient, 0.5, intercept)
    assert first > 0 > second


def test_points_that_are_the_same_in_both_classes_do_no_harm() -> None:
    features = np.zeros((20, 3), np.float32)
    support, coefficient, intercept = train_svm(features, np.arange(20) < 10, 1.0, 0.5)
    assert np.isfinite(decide(features, support, coefficient, 0.5, intercept)).all()
