"""Calibration of confidences, fitted on detections that are known to be right or wrong."""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from labeling.detectors.networks.spec import Calibration
from labeling.metrics.matching import MaskInstance, pairwise_iou

RIGHT_IOU = 0.5
"""Overlap from which on a detection of the right class counts as right."""
MIN_OUTCOMES = 20


def calibrated(scores: Float32[np.ndarray, "n"], calibration: Calibration) -> Float32[np.ndarray, "n"]:
    """Confidences from scores."""
    z = _logit(scores) / calibration.temperature + calibration.bias
    return (1 / (1 + np.exp(-z))).astype(np.float32)


def fit_calibration(scores: Sequence[float], right: Sequence[bool]) -> Calibration:
    """The calibration under which these outcomes are likeliest. Source: Platt 1999.

    Args:
        scores: of detections, before any calibration, in [0, 1].
        right: whether each was right.

    Returns:
        No change, if there is nothing to learn from: too few detections, or all of them right or wrong.
    """
    from scipy.optimize import minimize

    y = np.asarray(right, float)
    if len(y) < MIN_OUTCOMES or y.min() == y.max():
        return Calibration()
    logit = _logit(np.asarray(scores))

    def loss(parameters: np.ndarray) -> float:
        z = logit * np.exp(parameters[0]) + parameters[1]
        # A little pull towards no change keeps a handful of detections from deciding everything.
        return float(np.sum(np.logaddexp(0, z) - y * z) + 0.5 * np.sum(parameters**2))

    log_slope, bias = minimize(loss, np.zeros(2), method="BFGS").x
    return Calibration(float(np.exp(-log_slope)), float(bias))


def outcomes(found: Sequence[MaskInstance], truths: Sequence[MaskInstance]) -> tuple[list[float], list[bool]]:
    """Which detections are right, by COCO's rule: the more confident choose first, each object is found once.

    Args:
        found: detections of any pictures.
        truths: what there is to find. Detections that fall on what is ignored are left out.

    Returns:
        Scores, and whether each was right.
    """
    groups: dict[tuple, tuple[list[MaskInstance], list[MaskInstance]]] = defaultdict(lambda: ([], []))
    for side, items in enumerate((found, truths)):
        for item in items:
            groups[item.image, item.category][side].append(item)
    scores, right = [], []
    for candidates, there in groups.values():
        ranked = sorted(candidates, key=lambda item: -item.confidence)
        iou = pairwise_iou(ranked, there)
        free = np.ones(len(there), bool)
        for row, item in enumerate(ranked):
            open_to = np.where(free, iou[row], 0.0)
            best = int(open_to.argmax()) if len(there) else -1
            hit = best >= 0 and open_to[best] >= RIGHT_IOU
            if hit:
                free[best] = there[best].ignore
                if there[best].ignore:
                    continue
            scores.append(item.confidence)
            right.append(bool(hit))
    return scores, right


def _logit(scores: np.ndarray) -> np.ndarray:
    clipped = np.clip(scores.astype(np.float64), 1e-6, 1 - 1e-6)
    return np.log(clipped) - np.log1p(-clipped)
