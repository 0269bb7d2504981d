"""Calibration of confidences: how far they lie from what they predict."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class CalibrationCurve:
    """Predictions gathered in bins of equal width over [0, 1]; empty bins are left out."""

    confidence: Float[np.ndarray, "b"]
    """Mean in each bin."""
    outcome: Float[np.ndarray, "b"]
    """Mean of what came true in each bin."""
    count: Int[np.ndarray, "b"]

    @property
    def expected_calibration_error(self) -> float:
        """Mean distance of confidence and outcome, each bin counting with its predictions. Source: Guo et al. 2017."""
        return float(np.average(np.abs(self.confidence - self.outcome), weights=self.count))


def calibration_curve(
    confidence: Float[np.ndarray, "n"], outcome: Float[np.ndarray, "n"], num_bins: int = 10
) -> CalibrationCurve | None:
    """Bins predictions by confidence; None without any.

    Args:
        confidence: in [0, 1].
        outcome: what was predicted, in [0, 1], such as the IoU that a label turned out to have.
        num_bins: how many bins.
    """
    if len(confidence) == 0:
        return None
    bins = np.minimum((np.asarray(confidence) * num_bins).astype(int), num_bins - 1)
    count = np.bincount(bins, minlength=num_bins)
    used = np.flatnonzero(count)
    sums = (np.bincount(bins, weights=values, minlength=num_bins) for values in (confidence, outcome))
    means = [total[used] / count[used] for total in sums]
    return CalibrationCurve(means[0], means[1], count[used])
