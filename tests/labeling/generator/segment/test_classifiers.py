import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from labeling.generator.segment.classifiers import fit_plane, train_classifier


def two_clouds(seed: int, count: int = 300, apart: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    shape = rng.normal(0, 1, (6, 6))
    front = rng.normal(0, 1, (count, 6)) @ shape * 0.3 + rng.normal(0, apart, 6)
    return front, rng.normal(0, 1, (count + 50, 6)) + rng.normal(0, apart, 6)


def test_the_plane_is_that_of_scikit_learn() -> None:
    front, back = two_clouds(2, 100, 0.6)
    rows, names = np.concatenate([front, back]), np.repeat([1, 0], [len(front), len(back)])
    scaled = (rows - rows.mean(0)) / rows.std(0)
    rival = LogisticRegression(C=1.0, class_weight="balanced", tol=1e-8, max_iter=1000).fit(scaled, names)
    assert fit_plane(front, back).log_odds(rows) == pytest.approx(rival.decision_function(scaled), abs=2e-3)


@pytest.mark.parametrize("name", ["svm", "logistic"])
def test_classifiers_are_calibrated_and_the_same_for_the_same_seed(name: str) -> None:
    front, back = two_clouds(3, 600, 0.5)
    learnt = [
        train_classifier(name, front[:300], back[:300], np.random.default_rng(5))  # pyright: ignore[reportArgumentType]
        for _ in range(2)
    ]
    assert learnt[0] is not None
    assert learnt[1] is not None
    odds = [learnt[0].log_odds(points) for points in (front[300:], back[300:])]
    assert np.array_equal(odds[0], learnt[1].log_odds(front[300:]))
    chance = 1 / (1 + np.exp(-np.concatenate(odds).astype(float)))
    true = np.repeat([1, 0], [len(odds[0]), len(odds[1])])
    assert np.mean((chance > 0.5) == true) > 0.8
    likely = chance > 0.7
    assert true[likely].mean() == pytest.approx(chance[likely].mean(), abs=0.12)


def test_votes_alone_need_no_classifier() -> None:
    front, back = two_clouds(4, 20)
    assert train_classifier("votes", front, back, np.random.default_rng(0)) is None
    assert train_classifier("logistic", front[:2], back[:2], np.random.default_rng(0)) is not None
