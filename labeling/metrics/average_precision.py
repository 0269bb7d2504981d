"""Average precision of ranked predictions, whatever they are: what AP of masks and of 3-D boxes have in common."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

RECALLS = np.linspace(0.0, 1.0, 101)
"""Recall points of the interpolated area. Source: COCO."""


@dataclass(frozen=True)
class AveragePrecision:
    """AP at each IoU threshold, in [0, 1]; None where there is no ground truth to find."""

    mean: dict[float, float | None]
    """Threshold -> mean over the categories that have ground truth."""
    per_class: dict[str, dict[float, float | None]]
    """Category -> threshold -> AP, for every category of ground truth or predictions, sorted by name."""


def summarise(per_class: Mapping[str, dict[float, float | None]], thresholds: Sequence[float]) -> AveragePrecision:
    """AP by category, and its mean over categories."""
    mean = {t: mean_of([ap[t] for ap in per_class.values()]) for t in thresholds}
    return AveragePrecision(mean, dict(per_class))


def check_ranking(iou_thresholds: Sequence[float], confidences: Sequence[float]) -> list[float]:
    """The thresholds, as plain numbers.

    Raises:
        ValueError: if a threshold lies outside (0, 1], or a confidence is not finite.
    """
    thresholds = [float(t) for t in iou_thresholds]
    if not thresholds or not all(0 < t <= 1 for t in thresholds):
        raise ValueError(f"IoU thresholds lie in (0, 1], and there is at least one; given: {list(iou_thresholds)}")
    if not np.all(np.isfinite(confidences)):
        raise ValueError("confidences of predictions must be finite numbers")
    return thresholds


def all_point_area(right: Bool[np.ndarray, "n"], num_truths: int) -> float:
    """Area under the monotone precision-recall curve of ranked predictions. Source: Padilla et al. 2021, eq. 9-11.

    Args:
        right: for each prediction, the most confident first, whether it found a ground-truth instance of its own.
        num_truths: how many instances there are to find, at least 1.
    """
    # Recall rises by 1/num_truths at each right prediction and nowhere else.
    return float(_monotone_precision(right)[right].sum() / num_truths)


def interpolated_area(right: Bool[np.ndarray, "n"], num_truths: int) -> float:
    """Monotone precision, averaged over 101 recall points. Source: COCO.

    Args:
        right: as in ``all_point_area``.
        num_truths: how many instances there are to find, at least 1.
    """
    places = np.searchsorted(np.cumsum(right) / num_truths, RECALLS, side="left")
    return float(np.sum(_monotone_precision(right)[places[places < len(right)]]) / len(RECALLS))


def mean_of(values: Sequence[float | None]) -> float | None:
    """Mean of the defined values; None if there is none."""
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None


def _monotone_precision(right: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """The highest precision at each rank or any later one."""
    precision = np.cumsum(right) / np.arange(1, len(right) + 1)
    return np.maximum.accumulate(precision[::-1])[::-1]
