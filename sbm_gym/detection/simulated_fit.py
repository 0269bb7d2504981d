"""Fits the simulated detector's settings to what a real detector says in random views.

Logits of confidence are taken to be normal about what the settings say, and to go unreported below the least
confidence (a Tobit model; Tobin 1958), so that objects that are never detected count, too. Biases of categories,
penalties and the spread of all noise together are those of highest posterior; the noise is then divided by how far
logits of one object differ between views from one place, from one side, and from different sides.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int

from sbm_gym.detection.detector_views import CellView, DetectorViews, ObjectView
from sbm_gym.detection.lasting_phantoms import LastingPhantoms
from sbm_gym.detection.simulated import (
    DEFAULT_TRAITS,
    TRAITS,
    CategoryTraits,
    SimulatedDetector,
    SimulatedDetectorConfig,
)

HIGHEST = 0.995
"""Confidences above are taken for this, since their logits are anything."""
SHARPNESS = 4.0
"""How sharply the penalty for small objects sets in, per halving of their side; the simulated detector's does at
once."""
MODEL_SIGMA, PHANTOM_SIGMA = 1.0, 2.0
"""Expected spreads of biases per furniture model and per cell, which keep those seen a few times near zero."""
OTHER_SIDE_RAD = 1.2
"""Views of an object from directions that differ more show different sides of it."""


def fit_settings(
    views: DetectorViews, start: SimulatedDetectorConfig, phantoms: LastingPhantoms
) -> SimulatedDetectorConfig:
    """Settings under which the simulated detector says the like of what a real one has said.

    Args:
        views: what that was.
        start: settings of the kind of world; what cannot be fitted stays.
        phantoms: cells and heights that the background was divided by.

    Raises:
        ValueError: if objects are detected too seldom to fit anything.
    """
    seen = [one for one in views.objects if one.area_share >= start.min_area_share]
    settings = _fit_objects(seen, start)
    cells = [one for one in views.cells if one.area_share >= start.min_area_share]
    return replace(settings, lasting_phantoms=_fit_phantoms(cells, start, phantoms))


def predicted_shares(
    settings: SimulatedDetectorConfig, views: Sequence[ObjectView], thresholds: Sequence[float]
) -> Float64[np.ndarray, "thresholds"]:
    """The share of views of objects in which the simulated detector is expected to be at least so confident.

    Args:
        settings: of the detector; biases per model and object are averaged over.
        views: of objects of categories that it knows.
        thresholds: confidences.
    """
    from scipy.stats import norm

    certain = SimulatedDetector(replace(settings, model_sigma=0.0, object_sigma=0.0, viewpoint_sigma=0.0))
    means = np.array([certain.logit(one.observed, one.area_share) for one in views])
    c = settings
    spread = np.sqrt(c.model_sigma**2 + c.object_sigma**2 + c.viewpoint_sigma**2 + c.pose_sigma**2 + c.frame_sigma**2)
    return np.array([norm.sf((_logit(np.array(level)) - means) / spread).mean() for level in thresholds])


def _fit_objects(views: Sequence[ObjectView], start: SimulatedDetectorConfig) -> SimulatedDetectorConfig:
    known = [one.observed.category in start.categories for one in views]
    # Of what it does not know the simulated detector is half as sure as of anything else.
    confidence = np.array(
        [one.right if is_known else 2.0 * one.wrong for one, is_known in zip(views, known, strict=True)]
    )
    logits, unseen, least = _censored(confidence, start.min_confidence)
    if np.count_nonzero(~unseen) < 50:
        raise ValueError(
            f"{np.count_nonzero(~unseen)} detections of objects in {len(views)} views of objects: too few to fit"
        )
    categories, category = _numbered([one.observed.category for one in views])
    models, model = _numbered([one.observed.model_key for one in views])
    num, last = len(categories), 2 * len(categories)
    side = np.log2(np.sqrt([one.area_share for one in views]))
    behind = np.array([(0.5 * (1.0 - np.cos(one.observed.azimuth_rad))) ** 1.5 for one in views])
    hidden = np.array([max(0.0, 1.0 - one.observed.visible_share / 0.9) ** 1.3 for one in views])
    truncated = np.array([one.observed.truncated_share**1.5 for one in views])
    above = np.array([max(0.0, one.observed.elevation_rad - start.easy_elevation_rad) for one in views])
    columns = [torch.tensor(one) for one in (side, behind, hidden, truncated, above)]
    target, missing = torch.tensor(logits), torch.tensor(unseen)

    def means(p: torch.Tensor) -> torch.Tensor:
        side, behind, hidden, truncated, above = columns
        small = torch.nn.functional.softplus(SHARPNESS * (p[last + 4] - side)) / SHARPNESS
        penalties = p[last : last + 4].exp()
        mean = p[:num][category] + p[last + 6 :][model] - p[num:last].exp()[category] * behind
        return mean - penalties[0] * small - penalties[1] * hidden - penalties[2] * truncated - penalties[3] * above

    def loss(p: torch.Tensor) -> torch.Tensor:
        prior = ((p[last + 6 :] / MODEL_SIGMA) ** 2).sum() + 1e-2 * (p[:num] ** 2).sum()
        # Being seen from behind costs nothing, unless views say so.
        prior = prior + p[num:last].exp().sum()
        return 0.5 * prior - _log_likelihood(means(p), p[last + 5].exp(), target, missing, least).sum() / _REPEATS

    first = np.zeros(last + 6 + len(models))
    first[last : last + 4] = np.log([start.size_gain, start.hidden_penalty, start.truncated_penalty, 2.0])
    first[last + 4], first[last + 5] = np.log2(start.good_size), np.log(2.0)
    p = _minimised(loss, first)
    penalties, spread = np.exp(p[last : last + 4]), float(np.exp(p[last + 5]))
    with torch.no_grad():
        residual = logits - means(torch.tensor(p)).numpy()
    shares = _shares_of_noise(views, residual, unseen | (confidence > HIGHEST))
    base = float(p[:num].mean())
    traits = {
        name: CategoryTraits(
            float(p[k] - base), float(np.exp(p[num + k])), TRAITS.get(name, DEFAULT_TRAITS).mistaken_for
        )
        for k, name in enumerate(categories)
    }
    return replace(
        start,
        base_logit=base,
        size_gain=float(penalties[0]),
        good_size=float(2.0 ** p[last + 4]),
        hidden_penalty=float(penalties[1]),
        truncated_penalty=float(penalties[2]),
        above_penalty_per_rad=float(penalties[3]),
        model_sigma=float(p[last + 6 :].std()),
        object_sigma=spread * float(np.sqrt(shares["object"])),
        viewpoint_sigma=spread * float(np.sqrt(shares["viewpoint"])),
        pose_sigma=spread * float(np.sqrt(shares["pose"])),
        frame_sigma=0.0,
        confusion=_confusion([one for one, is_known in zip(views, known, strict=True) if is_known], start),
        phantoms_per_view=0.5,
        traits=traits,
    )


_REPEATS = 5.0
"""Views of one object resemble each other: so many count as one."""


def _shares_of_noise(
    views: Sequence[ObjectView], residual: Float[np.ndarray, "n"], unknown: Bool[np.ndarray, "n"]
) -> dict[str, float]:
    """How the variance of what is not explained divides into bias per object, what is smooth, and noise per pose."""
    of_object: dict[str, list[int]] = defaultdict(list)
    for index in np.flatnonzero(~unknown).tolist():
        of_object[views[index].observed.object_key].append(index)
    same_place, other_side, means = [], [], []
    for indices in of_object.values():
        if len(indices) >= 8:
            means.append(float(residual[indices].mean()))
        for one, other in combinations(indices[:200], 2):
            half_square = 0.5 * (residual[one] - residual[other]) ** 2
            turn_rad = views[one].observed.azimuth_rad - views[other].observed.azimuth_rad
            if views[one].place == views[other].place:
                same_place.append(half_square)
            elif np.cos(turn_rad) < np.cos(OTHER_SIDE_RAD):
                other_side.append(half_square)
    pose = float(np.mean(same_place)) if same_place else 1.0
    viewpoint = max(float(np.mean(other_side)) - pose, 0.0) if other_side else 1.0
    bias = float(np.var(means)) if len(means) > 1 else 0.0
    total = pose + viewpoint + bias
    return {"pose": pose / total, "viewpoint": viewpoint / total, "object": bias / total}


def _confusion(views: Sequence[ObjectView], start: SimulatedDetectorConfig) -> float:
    """What share of detections is called something else, beyond 2 %, in units of what the simulated detector takes."""
    surest = np.array([max(one.right, one.wrong) for one in views])
    wrong = np.array([one.wrong > one.right for one in views])
    found = surest >= start.min_confidence
    expected = ((1.0 - surest[found]) ** 1.5).sum()
    return float(np.clip((wrong[found].sum() - 0.02 * found.sum()) / expected, 0.0, 1.0))


def _fit_phantoms(
    cells: Sequence[CellView], start: SimulatedDetectorConfig, phantoms: LastingPhantoms
) -> LastingPhantoms | None:
    """None if nothing in the background is ever taken for an object."""
    taken_for = Counter(one.category for one in cells if one.category in start.categories)
    if not taken_for:
        return None
    logits, unseen, least = _censored(np.array([one.confidence for one in cells]), start.min_confidence)
    names, cell = _numbered([one.cell for one in cells])
    side = torch.tensor(np.log2(np.sqrt([one.area_share for one in cells])))
    target, missing = torch.tensor(logits), torch.tensor(unseen)

    def loss(p: torch.Tensor) -> torch.Tensor:
        mean = p[0] + p[2] * side + p[3:][cell]
        prior = 0.5 * ((p[3:] / PHANTOM_SIGMA) ** 2).sum()
        return prior - _log_likelihood(mean, p[1].exp(), target, missing, least).sum()

    first = np.zeros(3 + len(names))
    first[:3] = -3.0, np.log(2.0), 1.0
    p = _minimised(loss, first)
    total = sum(taken_for.values())
    return replace(
        phantoms,
        logit_when_full=float(p[0]),
        size_gain=float(p[2]),
        cell_sigma=float(p[3:].std()),
        pose_sigma=float(np.exp(p[1])),
        categories=tuple((name, count / total) for name, count in taken_for.most_common()),
    )


# Parts of both ----------------------------------------------------------------------------------------------------


def _logit(share: Float[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
    return np.log(share) - np.log1p(-share)


def _censored(
    confidence: Float[np.ndarray, "n"], min_confidence: float
) -> tuple[Float64[np.ndarray, "n"], Bool[np.ndarray, "n"], float]:
    """Logits of confidences, where there is none, and the logit of the least one."""
    logits = _logit(np.clip(confidence, min_confidence, HIGHEST))
    return logits, confidence < min_confidence, float(_logit(np.array(min_confidence)))


def _numbered(keys: Sequence[str]) -> tuple[list[str], Int[np.ndarray, "n"]]:
    """The different keys in order, and which of them each is."""
    names, number = np.unique(np.array(keys), return_inverse=True)
    return names.tolist(), number


def _log_likelihood(
    mean: torch.Tensor, spread: torch.Tensor, target: torch.Tensor, missing: torch.Tensor, least: float
) -> torch.Tensor:
    """Of a Tobit model, up to a constant, for each observation."""
    z = (target - mean) / spread
    return torch.where(missing, torch.special.log_ndtr((least - mean) / spread), -0.5 * z * z - spread.log())


def _minimised(
    loss: Callable[[torch.Tensor], torch.Tensor], first: Float64[np.ndarray, "n"]
) -> Float64[np.ndarray, "n"]:
    from scipy.optimize import minimize

    def value_and_gradient(numbers):
        p = torch.tensor(numbers, requires_grad=True)
        value = loss(p)
        value.backward()
        assert p.grad is not None
        return float(value.detach()), p.grad.numpy()

    return minimize(value_and_gradient, first, jac=True, method="L-BFGS-B", options={"maxiter": 1000}).x
