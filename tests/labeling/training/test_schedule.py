import numpy as np
import pytest

from labeling.training.loop import scheduled_rate


def test_rates_rise_during_the_warmup_and_then_stay():
    constant = [scheduled_rate(0.5, step, 10, step / 100, "constant") for step in range(100)]
    assert constant[0] == pytest.approx(0.05)
    assert np.all(np.diff(constant[:10]) > 0)
    assert set(constant[9:]) == {0.5}


def test_rates_fall_along_a_cosine_to_a_hundredth():
    rates = [scheduled_rate(0.5, step, 10, step / 100) for step in range(101)]
    assert np.all(np.diff(rates[10:]) < 0)
    assert rates[50] == pytest.approx(0.5 * 0.505)
    assert rates[100] == pytest.approx(0.005)
    assert scheduled_rate(0.5, 200, 10, 2.0) == rates[100]  # training that goes on beyond its end
    assert scheduled_rate(0.5, 0) == 0.5  # without a warm-up
