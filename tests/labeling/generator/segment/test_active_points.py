import numpy as np
import pytest

from labeling.generator.segment.active_points import ActivePoints
from labeling.generator.segment.mean_field import Kernel
from labeling.generator.segment.permutohedral_lattice import build_lattice

from .dense_mean_field import mean_field


def scene(seed: int = 0, count: int = 1500, objects: int = 3):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 3, (count, 3))
    log_odds = rng.normal(0, 2, (count, objects)).astype(np.float32)
    return points, log_odds, rng


def kernels_of(active: ActivePoints, points: np.ndarray) -> list[Kernel]:
    return [
        Kernel(build_lattice(points[active.point] / width, active.block_start), weight)
        for width, weight in ((0.4, 3.0), (0.15, 1.0))
    ]


@pytest.mark.parametrize("exclusive", [True, False])
def test_active_everything_is_the_whole_crf(exclusive: bool) -> None:
    points, log_odds, _ = scene()
    active = ActivePoints.of(np.ones(log_odds.shape, bool))
    ours = active.marginals(log_odds, kernels_of(active, points), 5, exclusive)
    whole = [Kernel(build_lattice(points / width), weight) for width, weight in ((0.4, 3.0), (0.15, 1.0))]
    np.testing.assert_allclose(ours, mean_field(log_odds, whole, 5, exclusive=exclusive), atol=1e-4)


def test_an_object_is_nowhere_but_active_it() -> None:
    points, log_odds, rng = scene(1)
    allowed = rng.random(log_odds.shape) < 0.4
    active = ActivePoints.of(allowed)
    probability = active.marginals(log_odds + 5, kernels_of(active, points), 3, True)
    assert np.all(probability[~allowed] == 0)
    assert np.all(probability[allowed] > 0)
    assert np.all(probability.sum(axis=1) <= 1 + 1e-5)


def test_objects_alone_do_not_see_each_other() -> None:
    points, log_odds, rng = scene(2)
    allowed = rng.random(log_odds.shape) < 0.5
    active = ActivePoints.of(allowed)
    before = active.marginals(log_odds, kernels_of(active, points), 5, False)
    changed = log_odds.copy()
    changed[:, 1] = 9.0
    after = active.marginals(changed, kernels_of(active, points), 5, False)
    np.testing.assert_array_equal(before[:, [0, 2]], after[:, [0, 2]])
    assert not np.array_equal(before[:, 1], after[:, 1])


def test_objects_that_compete_take_points_from_each_other() -> None:
    points, log_odds, _ = scene(3, objects=2)
    active = ActivePoints.of(np.ones(log_odds.shape, bool))
    kernels = kernels_of(active, points)
    strong = log_odds.copy()
    strong[:, 1] += 6
    before, after = (active.marginals(one, kernels, 3, True)[:, 0].sum() for one in (log_odds, strong))
    assert after < 0.2 * before


def test_rows_and_table_undo_each_other() -> None:
    rng = np.random.default_rng(4)
    allowed = rng.random((50, 4)) < 0.3
    values = rng.random((50, 4)).astype(np.float32)
    active = ActivePoints.of(allowed)
    np.testing.assert_array_equal(active.scatter(active.gather(values)), np.where(allowed, values, 0))


@pytest.mark.parametrize("shape", [(0, 0), (10, 0), (10, 2)])
def test_nothing_active_is_nothing(shape: tuple[int, int]) -> None:
    active = ActivePoints.of(np.zeros(shape, bool))
    assert not active.marginals(np.zeros(shape, np.float32), [], 5, True).any()
