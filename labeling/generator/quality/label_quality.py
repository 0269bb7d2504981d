"""The quality of a label: its expected IoU, from the detections of its object in all views and from its own mask.

The model is a logistic function of a sum of monotone functions of a few features, in the direction that ``FEATURES``
gives; each category then has a line of its own in the log-odds, for what is said of a chair may be worth less than what
is said of a bed. It is fitted to ground truth of training episodes of each detector by
``python -m experiments.calibrate_labels``.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from labeling.core.masks import pairwise_mask_iou
from labeling.core.types import Detection, PseudoLabel
from labeling.generator.objects.object_posterior import log_odds

if TYPE_CHECKING:
    from labeling.core.episode_labels import EpisodeLabels

SAME_PLACE_IOU = 0.3
"""Least IoU with a label of a detection that is of the label's object."""
PIXELS_A_SIDE = 128
"""About how many pixels a side masks are compared at."""
MIN_VIEW_PX = 16.0
"""At that resolution: views that show fewer pixels of an object have next to no weight."""

FEATURES = {
    "posterior": 1,
    "mean_probability": 1,
    "best_detection": 1,
    "agreement": 1,
    "agreeing_views": 1,
    "contradiction": -1,
    "own_detection": 1,
    "visible_size": 1,
    "visible_share": 1,
}
"""Name -> whether more of it is better (1) or worse (-1). posterior: the chance of the object's category, log-odds.
mean_probability: in the mask, log-odds. best_detection: highest confidence of a detection of the object under its name,
log-odds. agreement and contradiction: mean over the views that show the object, each weighted with the size it is seen
at, of the confidence of the detection of it under its name, and under another one; 0 in views where the detector finds
nothing, so that missed detections count against the object. agreeing_views: log2 of 1 + how many views found it.
own_detection: IoU with the detection in the label's own view, times its confidence. visible_size: log2 of the side of
the visible part, as a share of the picture's. visible_share: of the whole object, what is visible."""
COLUMN = {name: column for column, name in enumerate(FEATURES)}


SEGMENTS = 3
"""Of the straight pieces that a feature's effect consists of; between their ends lie equally many labels. Three did
best on training homes left out of the fit: error of calibration .045 of episodes alone and .018 of joint ones, where
one (a line) has .061 and .056."""


LEAST_LABELS = 20
"""Categories with fewer labels have no line of their own."""
LINE_PRIOR = np.array([20.0, 5.0])
"""Weights of the squared distances of a scale from 1 and of a bias from 0, beside the loss of a category's labels."""
MAX_ODDS = 30.0
"""Bound of log-odds."""


@dataclass(frozen=True)
class LabelQualityModel:
    """Expected IoU of a label: a logistic function of a sum of one monotone, piecewise linear function of each feature,
    followed by a line for each category.

    Sources: Hastie and Tibshirani, "Generalized Additive Models" (1986); Platt, "Probabilistic outputs for support
    vector machines" (1999), for the lines.
    """

    knots: Float[np.ndarray, "f k"]
    """Where the pieces of each feature's function meet, ascending; beyond the outermost it is constant."""
    gain: Float[np.ndarray, "f k-1"]
    """By how much the log-odds change over each piece in the direction that ``FEATURES`` names; 0 or more."""
    intercept: float
    lines: Mapping[str, Float[np.ndarray, "2"]] = field(default_factory=dict)
    """Category -> scale (0 or more) and bias of the log-odds of its labels; 1 and 0 for categories that are not in
    it."""

    def expected_iou(self, features: Float[np.ndarray, "n f"], categories: Sequence[str]) -> Float[np.ndarray, "n"]:
        """Expected IoU, in (0, 1), of labels with these features and of these categories."""
        odds = self.common_odds(features)
        if self.lines:
            scale, bias = np.array([self.lines.get(name, (1.0, 0.0)) for name in categories]).reshape(-1, 2).T
            odds = scale * odds + bias
        return _chance(odds)

    def common_odds(self, features: Float[np.ndarray, "n f"]) -> Float[np.ndarray, "n"]:
        """Log-odds of labels before the lines of their categories."""
        return _ramps(features, self.knots) @ self.gain.ravel() + self.intercept


def fit_model(
    features: Float[np.ndarray, "n f"],
    iou: Float[np.ndarray, "n"],
    categories: Sequence[str],
    ridge: float = 0.003,
    steps: int = 4000,
) -> LabelQualityModel:
    """Fits the model to measured IoU by maximum likelihood of a fractional logistic regression; then the lines.

    Args:
        features: of the labels, in the order of ``FEATURES``.
        iou: of each label with the ground truth it names, in [0, 1].
        categories: of the labels.
        ridge: weight of the squared gains of pieces, standardised; .003 did best on training homes left out of the fit.
        steps: of accelerated projected gradient; the problem is convex.

    Source: Papke and Wooldridge, "Econometric methods for fractional response variables" (1996).
    """
    knots = np.stack([_quantiles(column) for column in features.T])
    ramps = _ramps(features, knots)
    mean, scale = ramps.mean(axis=0), ramps.std(axis=0)
    scale = np.where(scale > 1e-9, scale, 1.0)
    design = np.concatenate([(ramps - mean) / scale, np.ones((len(ramps), 1))], axis=1)
    penalty = np.append(np.full(ramps.shape[1], ridge), 0.0)
    step = 1.0 / (0.25 * np.linalg.norm(design, 2) ** 2 / len(design) + ridge)
    weight = ahead = np.zeros(design.shape[1])
    for i in range(steps):
        moved = ahead - step * (design.T @ (_chance(design @ ahead) - iou) / len(iou) + penalty * ahead)
        moved[:-1] = np.maximum(moved[:-1], 0.0)
        ahead = moved + i / (i + 3) * (moved - weight)
        weight = moved
    gain = weight[:-1] / scale
    common = LabelQualityModel(knots, gain.reshape(len(knots), -1), float(weight[-1] - gain @ mean))
    odds, names = common.common_odds(features), np.array(categories)
    found = {str(name): names == name for name in np.unique(names)}
    lines = {name: _fit_line(odds[own], iou[own]) for name, own in found.items() if own.sum() >= LEAST_LABELS}
    return replace(common, lines=lines)


def _fit_line(odds: Float[np.ndarray, "n"], iou: Float[np.ndarray, "n"]) -> Float[np.ndarray, "2"]:
    """Scale and bias of log-odds, by maximum likelihood with a prior that draws them to 1 and 0."""
    from scipy.optimize import minimize

    inputs = np.stack([odds, np.ones(len(odds))], axis=1)

    def loss(line):
        now, away = inputs @ line, line - [1.0, 0.0]
        slope = inputs.T @ (_chance(now) - iou) + 2 * LINE_PRIOR * away
        return float((np.logaddexp(0, now) - iou * now).sum() + LINE_PRIOR @ away**2), slope

    return minimize(loss, [1.0, 0.0], jac=True, bounds=[(0, None), (None, None)], method="L-BFGS-B").x


def _chance(odds: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    return 1 / (1 + np.exp(-np.clip(odds, -MAX_ODDS, MAX_ODDS)))


def _quantiles(column: Float[np.ndarray, "n"]) -> Float[np.ndarray, "k"]:
    """Ends of pieces with equally many values each; fewer where values repeat, and the rest beyond all values.

    They differ by more than a calibration's file rounds away.
    """
    ends = np.unique(np.round(np.quantile(column, np.linspace(0, 1, SEGMENTS + 1)), 6))
    return np.concatenate([ends, ends[-1] + np.arange(1, SEGMENTS + 2 - len(ends))])


def _ramps(features: Float[np.ndarray, "n f"], knots: Float[np.ndarray, "f k"]) -> Float[np.ndarray, "n f*(k-1)"]:
    """How far each feature has come along each piece, from 0 to 1, with the sign that ``FEATURES`` gives it."""
    ends = np.diff(knots, axis=1)
    along = np.clip((features[:, :, None] - knots[None, :, :-1]) / ends, 0.0, 1.0)
    sign = np.array([*FEATURES.values()])
    return (along * sign[:, None]).reshape(len(features), ends.size)


def features_of(labels: "EpisodeLabels", detections: Sequence[Detection]) -> Float[np.ndarray, "n f"]:
    """Features of the labels of an episode whose confidences are still their objects' times their mean probability."""
    object_confidence = {one.instance_id: max(one.confidence, 1e-6) for one in labels.objects}
    mean_probability = [min(1.0, one.confidence / object_confidence[one.instance_id]) for one in labels.labels]
    return label_features(
        labels.labels, [object_confidence[one.instance_id] for one in labels.labels], mean_probability, detections
    )


def label_features(
    labels: Sequence[PseudoLabel],
    posterior: Sequence[float],
    mean_probability: Sequence[float],
    detections: Sequence[Detection],
) -> Float[np.ndarray, "n f"]:
    """Features of all labels of an episode, in the order of ``FEATURES``.

    Args:
        labels: of all views.
        posterior: of each label's object and category.
        mean_probability: within each label's mask.
        detections: all there are, confident or not.
    """
    if not labels:
        return np.zeros((0, len(FEATURES)))
    size = labels[0].modal.shape
    stride = max(1, round(float(np.sqrt(size[0] * size[1])) / PIXELS_A_SIDE))
    thinned = [np.ascontiguousarray(one.modal[::stride, ::stride]) for one in labels]
    sides = np.sqrt([np.count_nonzero(mask) for mask in thinned])
    wholes = np.array([np.count_nonzero(np.ascontiguousarray(one.amodal[::stride, ::stride])) for one in labels])
    same, other, own = _votes(labels, thinned, detections, stride)
    rows = np.zeros((len(labels), len(FEATURES)))
    by_object: dict[int, list[int]] = {}
    for index, one in enumerate(labels):
        by_object.setdefault(one.instance_id, []).append(index)
    for members in by_object.values():
        view_weight = sides[members] * (sides[members] ** 2 >= MIN_VIEW_PX) + 1e-6
        rows[members, COLUMN["best_detection"]] = log_odds(same[members].max())
        rows[members, COLUMN["agreement"]] = view_weight @ same[members] / view_weight.sum()
        rows[members, COLUMN["agreeing_views"]] = np.log2(1 + np.count_nonzero(same[members]))
        rows[members, COLUMN["contradiction"]] = view_weight @ other[members] / view_weight.sum()
    side = float(np.sqrt(size[0] * size[1])) / stride
    rows[:, COLUMN["posterior"]] = log_odds(np.asarray(posterior, float))
    rows[:, COLUMN["mean_probability"]] = log_odds(np.asarray(mean_probability, float))
    rows[:, COLUMN["own_detection"]] = own
    rows[:, COLUMN["visible_size"]] = np.log2(np.clip(sides / side, 1 / 64, 0.25))
    rows[:, COLUMN["visible_share"]] = sides**2 / np.maximum(wholes, 1)
    return rows


def _votes(labels: Sequence[PseudoLabel], thinned, detections: Sequence[Detection], stride: int):
    """For each label the best confidence in its view under its name, under another, and the first times IoU."""
    same, other, own = (np.zeros(len(labels)) for _ in range(3))
    labels_of, found_in = defaultdict(list), defaultdict(list)
    for index, one in enumerate(labels):
        labels_of[one.view_index].append(index)
    for one in detections:
        found_in[one.view_index].append(one)
    for view, here in labels_of.items():
        found = found_in.get(view)
        if not found:
            continue
        overlap = pairwise_mask_iou(
            np.stack([thinned[index] for index in here]),
            np.stack([one.mask[::stride, ::stride] for one in found]),
        )
        for row, index in enumerate(here):
            for column in np.flatnonzero(overlap[row] >= SAME_PLACE_IOU):
                one = found[column]
                if one.category == labels[index].category:
                    same[index] = max(same[index], one.confidence)
                    own[index] = max(own[index], one.confidence * overlap[row, column])
                else:
                    other[index] = max(other[index], one.confidence)
    return same, other, own
