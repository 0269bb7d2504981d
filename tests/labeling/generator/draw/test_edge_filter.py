import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from .filled import edge_aware_fill


def flat_guide(height: int, width: int) -> np.ndarray:
    return np.zeros((height, width, 3), np.uint8)


@settings(max_examples=25)
@given(st.floats(-5, 5), st.integers(0, 1000), st.floats(1, 20))
def test_a_constant_stays_a_constant(value: float, seed: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    guide = rng.integers(0, 256, (12, 15, 3), dtype=np.uint8)
    weight = (rng.random((12, 15)) + 0.01).astype(np.float32)
    filled, _ = edge_aware_fill(np.full((12, 15, 1), value, np.float32), weight, guide, reach, 0.3)
    np.testing.assert_allclose(filled, value, atol=1e-3)


def test_filter_on_a_flat_guide_has_the_reach_asked_for() -> None:
    values = np.zeros((101, 101, 1), np.float32)
    values[50, 50] = 1
    filled, _ = edge_aware_fill(values, np.ones((101, 101), np.float32), flat_guide(101, 101), 6.0, 0.3)
    row = filled[50, :, 0].astype(float)
    x = np.arange(101) - 50
    assert np.sqrt(np.sum(row * x**2) / row.sum()) == pytest.approx(6.0, rel=0.15)
    np.testing.assert_allclose(row, row[::-1], rtol=1e-3, atol=1e-7)


def test_holes_take_the_values_of_their_side_of_an_edge() -> None:
    guide = flat_guide(20, 40)
    guide[:, 20:] = 255
    values = np.zeros((20, 40, 1), np.float32)
    values[:, 20:] = 1
    weight = np.ones((20, 40), np.float32)
    weight[:, 14:26] = 0
    filled, _ = edge_aware_fill(values, weight, guide, 8.0, 0.3)
    assert filled[:, :20].max() < 0.1
    assert filled[:, 20:].min() > 0.9


def test_values_without_weight_are_never_read() -> None:
    rng = np.random.default_rng(0)
    weight = (rng.random((10, 10)) > 0.5).astype(np.float32)
    values = rng.random((10, 10, 2)).astype(np.float32)
    other = np.where(weight[:, :, None] > 0, values, 7).astype(np.float32)
    guide = rng.integers(0, 256, (10, 10, 3), dtype=np.uint8)
    np.testing.assert_array_equal(
        edge_aware_fill(values, weight, guide, 5.0, 0.3)[0], edge_aware_fill(other, weight, guide, 5.0, 0.3)[0]
    )


def test_weight_tells_where_nothing_is_known() -> None:
    weight = np.zeros((30, 200), np.float32)
    weight[:, :5] = 1
    _, total = edge_aware_fill(np.ones((30, 200, 1), np.float32), weight, flat_guide(30, 200), 3.0, 0.3)
    assert total[:, :5].min() > 0.1
    assert total[:, 100:].max() < 1e-6
