import numpy as np
import pytest
from scipy.stats import multivariate_normal

from labeling.generator.segment.gaussian_classifier import (
    MAX_LOG_ODDS,
    RIDGE,
    train_classifier,
    train_gaussian_classifier,
)
from labeling.generator.segment.svm_classifier import train_svm_classifier


@pytest.fixture(scope="module")
def points() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    return rng.normal(0, 0.2, (300, 6)), rng.normal(0.5, [0.1, 0.2, 0.3, 0.4, 1.0, 2.0], (300, 6))


def test_log_odds_are_the_ratio_of_two_normal_densities(points) -> None:
    front, back = points
    scale = np.concatenate(points).std(axis=0)
    queries = np.random.default_rng(1).normal(0, 1, (50, 6))
    expected = np.subtract(
        *(
            multivariate_normal.logpdf(
                queries / scale,
                (one / scale).mean(axis=0),
                np.cov((one / scale).T) + RIDGE * np.eye(6),  # pyright: ignore[reportArgumentType]
            )
            for one in points
        )
    )
    assert np.allclose(train_gaussian_classifier(front, back).log_odds(queries), expected, rtol=1e-3, atol=1e-2)


def test_units_of_the_features_do_not_matter(points) -> None:
    front, back = points
    units = np.array([1, 10, 0.1, 1000, 1, 0.01])
    plain = train_gaussian_classifier(front, back).log_odds(front)
    assert np.allclose(
        train_gaussian_classifier(front * units, back * units).log_odds(front * units), plain, rtol=1e-3, atol=1e-2
    )


def test_a_flat_object_or_a_single_point_has_finite_log_odds(points) -> None:
    _, back = points
    flat = np.zeros((20, 6))
    for front in (flat, flat[:1]):
        assert np.isfinite(train_gaussian_classifier(front, back).log_odds(back)).all()
        assert np.isfinite(train_gaussian_classifier(back, front).log_odds(back)).all()
    assert np.isfinite(train_gaussian_classifier(flat, flat).log_odds(flat)).all()


def test_the_share_leads_from_the_machine_to_the_gaussians(points) -> None:
    front, back = points
    queries = np.concatenate(points)

    def trained(share: float) -> np.ndarray:
        return train_classifier(front, back, np.random.default_rng(0), share).log_odds(queries)

    assert np.array_equal(trained(0.0), train_svm_classifier(front, back, np.random.default_rng(0)).log_odds(queries))
    assert np.array_equal(trained(1.0), train_gaussian_classifier(front, back).log_odds(queries))
    held = [np.clip(trained(share), -MAX_LOG_ODDS, MAX_LOG_ODDS) for share in (0.0, 1.0)]
    assert np.allclose(trained(0.25), 0.75 * held[0] + 0.25 * held[1], atol=1e-5)


def test_gaussians_close_a_shape_that_all_seeds_lack_a_part_of() -> None:
    """Detections that all miss the lower part of a box: background seeds lie on it, the machine learns the cut."""
    rng = np.random.default_rng(3)

    def box(count: int, low: float, high: float) -> np.ndarray:
        xyz = rng.uniform([-0.5, -0.5, low], [0.5, 0.5, high], (count, 3))
        return np.concatenate([np.tile([0.2, 0.4, 0.8], (count, 1)) + rng.normal(0, 0.03, (count, 3)), xyz], axis=1)

    around = rng.uniform(-2, 2, (600, 3))
    brown = np.concatenate([np.tile([0.5, 0.3, 0.1], (600, 1)) + rng.normal(0, 0.05, (600, 3)), around], axis=1)
    front = box(300, 0.0, 1.0)
    back = np.concatenate([brown[:240], box(60, -0.5, -0.25)])
    missed = box(200, -0.25, 0.0)
    machine = train_svm_classifier(front, back, np.random.default_rng(0)).log_odds(missed)
    smooth = train_classifier(front, back, np.random.default_rng(0), 0.75).log_odds(missed)
    assert np.mean(smooth > 0) > np.mean(machine > 0)
    assert np.mean(train_classifier(front, back, np.random.default_rng(0), 0.75).log_odds(brown[240:]) < 0) > 0.95


@pytest.mark.parametrize("share", [0.0, 0.75])
def test_classifiers_are_calibrated_and_the_same_for_the_same_seed(share: float) -> None:
    rng = np.random.default_rng(3)
    shape = rng.normal(0, 1, (6, 6))
    front = rng.normal(0, 1, (600, 6)) @ shape * 0.3 + rng.normal(0, 0.5, 6)
    back = rng.normal(0, 1, (650, 6)) + rng.normal(0, 0.5, 6)
    learnt = [train_classifier(front[:300], back[:300], np.random.default_rng(5), share) for _ in range(2)]
    odds = [learnt[0].log_odds(points) for points in (front[300:], back[300:])]
    assert np.array_equal(odds[0], learnt[1].log_odds(front[300:]))
    chance = 1 / (1 + np.exp(-np.concatenate(odds).astype(float)))
    true = np.repeat([1, 0], [len(odds[0]), len(odds[1])])
    assert np.mean((chance > 0.5) == true) > 0.8
    likely = chance > 0.7
    assert true[likely].mean() == pytest.approx(chance[likely].mean(), abs=0.12)
