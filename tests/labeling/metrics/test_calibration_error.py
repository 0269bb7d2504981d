import numpy as np
import pytest

from labeling.metrics.calibration_error import calibration_curve


def test_honest_confidences_have_no_calibration_error() -> None:
    confidence = np.repeat(np.linspace(0.05, 0.95, 10), 100)
    honest = calibration_curve(confidence, confidence)
    boastful = calibration_curve(confidence, 0.5 * confidence)
    assert honest is not None
    assert boastful is not None
    assert honest.expected_calibration_error == pytest.approx(0)
    assert boastful.expected_calibration_error == pytest.approx(0.25)
    assert honest.count.tolist() == [100] * 10
    assert calibration_curve(np.zeros(0), np.zeros(0)) is None
