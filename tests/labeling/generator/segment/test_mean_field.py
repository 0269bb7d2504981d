import importlib

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from labeling.generator.segment.mean_field import Kernel
from labeling.generator.segment.permutohedral_lattice import build_lattice

from .dense_mean_field import log_odds, mean_field


class ExactFilter:
    """All pairwise sums."""

    def __init__(self, features: np.ndarray) -> None:
        self.kernel = np.exp(-0.5 * cdist(features, features, "sqeuclidean"))

    def filter(self, values: np.ndarray) -> np.ndarray:
        return (self.kernel @ values).astype(np.float32)


def textbook_mean_field(unary: np.ndarray, kernels: list[np.ndarray], weights: list[float], iterations: int):
    """All labels, background included, written down as in Kraehenbuehl and Koltun 2011, algorithm 1."""
    energy = np.concatenate([np.zeros((len(unary), 1)), unary], axis=1)
    q = np.exp(energy - energy.max(axis=1, keepdims=True))
    q /= q.sum(axis=1, keepdims=True)
    for _ in range(iterations):
        total = energy.copy()
        for kernel, weight in zip(kernels, weights, strict=True):
            root = 1 / np.sqrt(kernel.sum(axis=1))
            total += weight * (root[:, None] * kernel * root[None]) @ q
        q = np.exp(total - total.max(axis=1, keepdims=True))
        q /= q.sum(axis=1, keepdims=True)
    return q[:, 1:]


def scene(count: int, objects: int, seed: int = 0):
    """Coloured blobs in space with unreliable unaries."""
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, objects + 1, count)
    centres, colours = rng.uniform(0, 3, (objects + 1, 3)), rng.uniform(0, 1, (objects + 1, 3))
    points = centres[truth] + rng.normal(0, 0.4, (count, 3))
    colour = colours[truth] + rng.normal(0, 0.1, (count, 3))
    unary = np.where(truth[:, None] == np.arange(1, objects + 1), 0.7, -0.7) + rng.normal(0, 1.5, (count, objects))
    return points, colour, unary.astype(np.float32), truth


@pytest.mark.slow
@pytest.mark.parametrize("exclusive", [True, False])
def test_marginals_on_the_lattice_agree_with_brute_force(exclusive: bool) -> None:
    points, colour, unary, _ = scene(3000, 3)
    appearance, smoothness = np.concatenate([points / 0.5, colour / 0.2], axis=1), points / 0.2
    exact = [Kernel(ExactFilter(appearance), 4.0), Kernel(ExactFilter(smoothness), 1.0)]
    ours = [Kernel(build_lattice(appearance), 4.0), Kernel(build_lattice(smoothness), 1.0)]
    difference = np.abs(
        mean_field(unary, ours, 5, exclusive=exclusive) - mean_field(unary, exact, 5, exclusive=exclusive)
    )
    assert difference.mean() < 0.01
    assert np.quantile(difference, 0.99) < 0.15


def test_marginals_are_those_of_the_textbook() -> None:
    points, colour, unary, _ = scene(400, 3, seed=1)
    appearance, smoothness = np.concatenate([points / 0.5, colour / 0.2], axis=1), points / 0.3
    filters = [ExactFilter(appearance), ExactFilter(smoothness)]
    ours = mean_field(unary, [Kernel(filters[0], 3.0), Kernel(filters[1], 1.5)], 7)
    expected = textbook_mean_field(unary.astype(float), [f.kernel for f in filters], [3.0, 1.5], 7)
    np.testing.assert_allclose(ours, expected, atol=2e-4)


def test_independent_objects_are_binary_crfs_each() -> None:
    points, _, unary, _ = scene(300, 2, seed=2)
    kernel = ExactFilter(points / 0.4)
    together = mean_field(unary, [Kernel(kernel, 3.0)], 5, exclusive=False)
    for column in range(2):
        alone = textbook_mean_field(unary[:, [column]].astype(float), [kernel.kernel], [3.0], 5)
        np.testing.assert_allclose(together[:, [column]], alone, atol=2e-4)


def test_neighbours_correct_unreliable_unaries() -> None:
    points, colour, unary, truth = scene(3000, 3, seed=3)
    kernels = [Kernel(build_lattice(np.concatenate([points / 0.5, colour / 0.2], axis=1)), 4.0)]

    def accuracy(probability):
        labels = np.concatenate([1 - probability.sum(axis=1, keepdims=True), probability], axis=1).argmax(axis=1)
        return np.mean(labels == truth)

    assert accuracy(mean_field(unary, kernels, 5)) > accuracy(mean_field(unary, [], 5)) + 0.1


def test_objects_and_background_share_one_unit_of_probability() -> None:
    points, _, unary, _ = scene(500, 4, seed=4)
    probability = mean_field(10 * unary, [Kernel(build_lattice(points), 5.0)], 3)
    assert np.all(probability >= 0)
    assert np.all(probability.sum(axis=1) <= 1 + 1e-5)


def test_without_kernels_marginals_are_those_of_the_unaries() -> None:
    unary = log_odds(np.array([[0.3], [0.8]]))
    np.testing.assert_allclose(mean_field(unary, [], 5), [[0.3], [0.8]], atol=1e-6)


@pytest.mark.bench
def test_marginals_agree_with_pydensecrf() -> None:
    dcrf = importlib.import_module("pydensecrf.densecrf")  # of the "bench" extra, which type checkers need not find

    points, _, unary, _ = scene(3000, 1, seed=5)
    features = np.ascontiguousarray((points / 0.5).T, np.float32)
    rival = dcrf.DenseCRF(len(points), 2)
    chance = 1 / (1 + np.exp(-unary[:, 0]))
    rival.setUnaryEnergy(np.ascontiguousarray(-np.log(np.stack([1 - chance, chance])), np.float32))
    rival.addPairwiseEnergy(features, compat=3.0)
    theirs = np.array(rival.inference(5))[1]
    ours = mean_field(unary, [Kernel(build_lattice(points / 0.5), 3.0)], 5)[:, 0]
    assert np.abs(ours - theirs).mean() < 0.005
