import itertools

import numba
import numpy as np
import pytest
from scipy.spatial.distance import cdist

from labeling.generator.segment.permutohedral_lattice import build_lattice


def exact_filter(features: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * cdist(features, features, "sqeuclidean")) @ values


@pytest.mark.parametrize(("dimension", "tolerance"), [(2, 0.01), (3, 0.01), (6, 0.03)])
def test_filter_is_a_gaussian_up_to_one_factor(dimension: int, tolerance: float) -> None:
    rng = np.random.default_rng(dimension)
    features = rng.normal(size=(2500, dimension)) * (2.0 if dimension < 4 else 1.0)
    values = np.stack([features[:, 0] > 0, rng.random(2500), np.ones(2500)], axis=1).astype(np.float32)
    ours, exact = build_lattice(features).filter(values), exact_filter(features, values)
    means, exact_means = ours[:, :2] / ours[:, 2:], exact[:, :2] / exact[:, 2:]
    assert np.abs(means - exact_means).mean() < tolerance
    # The mean of noise over everything is one number: only a filter of the right width tells left from right.
    assert np.corrcoef(means[:, 0], exact_means[:, 0])[0, 1] > 0.99


def test_filter_has_the_width_of_sigma_one() -> None:
    """A single spike among many points: the response falls with distance as exp(-d^2 / 2)."""
    line = np.stack([np.linspace(-6, 6, 1201), np.zeros(1201), np.zeros(1201)], axis=1)
    rng = np.random.default_rng(0)
    widths = []
    for _ in range(20):
        features = line + rng.uniform(-50, 50, 3)
        spike = np.zeros((1201, 1), np.float32)
        spike[600] = 1
        response = build_lattice(features).filter(spike)[:, 0].astype(float)
        widths.append(np.sqrt(np.sum(response * line[:, 0] ** 2) / np.sum(response)))
    assert np.mean(widths) == pytest.approx(1.0, abs=0.08)


def test_filter_is_linear_and_channels_do_not_mix() -> None:
    rng = np.random.default_rng(1)
    lattice = build_lattice(rng.normal(size=(500, 6)))
    a, b = rng.random((500, 1), np.float32), rng.random((500, 1), np.float32)
    both = lattice.filter(np.concatenate([a, b, a + 2 * b], axis=1))
    np.testing.assert_allclose(both[:, :1], lattice.filter(a), rtol=1e-6)
    np.testing.assert_allclose(both[:, 2], both[:, 0] + 2 * both[:, 1], rtol=1e-4, atol=1e-6)


def test_filter_keeps_the_order_of_points() -> None:
    rng = np.random.default_rng(2)
    features, values = rng.normal(size=(800, 3)), rng.random((800, 2), np.float32)
    order = rng.permutation(800)
    straight = build_lattice(features).filter(values)
    shuffled = build_lattice(features[order]).filter(values[order])
    np.testing.assert_allclose(shuffled, straight[order], rtol=1e-4)


def test_result_does_not_depend_on_the_number_of_threads() -> None:
    rng = np.random.default_rng(3)
    features, values = rng.normal(size=(5000, 6)), rng.random((5000, 4), np.float32)
    before, results = numba.get_num_threads(), []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            results.append(build_lattice(features).filter(values))
    finally:
        numba.set_num_threads(before)
    assert all(np.array_equal(result, results[0]) for result in results)


def test_one_point_keeps_its_value() -> None:
    lattice = build_lattice(np.zeros((1, 6)))
    result = lattice.filter(np.array([[2.0, 4.0]], np.float32))
    assert result[0, 1] == pytest.approx(2 * result[0, 0])
    assert result[0, 0] > 0


def test_keys_beyond_63_bits_are_refused() -> None:
    wide = np.array([[0.0] * 6, [1e6] * 6])
    with pytest.raises(ValueError, match="63 bits"):
        build_lattice(wide)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_features_that_are_not_finite_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        build_lattice(np.full((3, 3), bad))


def test_values_of_another_length_are_refused() -> None:
    with pytest.raises(ValueError, match="3 points"):
        build_lattice(np.zeros((3, 2))).filter(np.zeros((4, 1), np.float32))


def test_blocks_are_lattices_of_their_own() -> None:
    rng = np.random.default_rng(5)
    features, values = rng.normal(size=(900, 6)), rng.random((900, 2), np.float32)
    blocks = np.array([0, 300, 300, 310, 900])
    together = build_lattice(features, blocks).filter(values)
    for first, last in itertools.pairwise(blocks):
        if last > first:
            alone = build_lattice(features[first:last]).filter(values[first:last])
            np.testing.assert_allclose(together[first:last], alone, rtol=1e-5, atol=1e-7)


def test_points_that_share_no_vertex_overfill_no_table() -> None:
    rng = np.random.default_rng(6)
    features = np.concatenate([np.zeros((2000, 6)), rng.uniform(-30, 30, (2000, 6))])
    lattice = build_lattice(features, np.array([0, 2000, 4000]))
    assert lattice.num_vertices > 10_000
    ones = lattice.filter(np.ones((4000, 1), np.float32))[:, 0]
    alone = build_lattice(np.zeros((1, 6))).filter(np.ones((1, 1), np.float32)).item()
    np.testing.assert_allclose(ones[:2000], 2000 * alone, rtol=1e-5)
    assert np.median(ones[2000:]) < 2


def test_blocks_do_not_depend_on_the_number_of_threads() -> None:
    rng = np.random.default_rng(7)
    features, values = rng.normal(size=(4000, 6)), rng.random((4000, 1), np.float32)
    blocks = np.array([0, 100, 2500, 2600, 3900, 4000])
    before, results = numba.get_num_threads(), []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            results.append(build_lattice(features, blocks).filter(values))
    finally:
        numba.set_num_threads(before)
    assert all(np.array_equal(result, results[0]) for result in results)


@pytest.mark.parametrize("blocks", [[0, 2], [1, 3], [0, 2, 1, 3]])
def test_blocks_that_are_not_those_of_the_points_are_refused(blocks: list[int]) -> None:
    with pytest.raises(ValueError, match="block_start"):
        build_lattice(np.zeros((3, 2)), np.array(blocks))
