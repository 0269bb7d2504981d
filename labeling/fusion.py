"""Log-odds of every object at every point: the direct votes of its sources, and a classifier trained on them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from labeling.label_config import LabelConfig
from labeling.merging import Candidate
from labeling.pointcloud import Cloud
from labeling.unaries import train_unary

FAR_LOG_ODDS = -8.0
"""Given to points out of an object's reach: they can never join it."""
MAX_LOG_ODDS = float(np.log(0.99 / 0.01))
"""Classifier outputs are held in [.01, .99]. Source: field notes (published code)."""
MAX_VOTES = 3.0
"""Sum of confidences at which more views of the same point stop adding weight: their errors are not independent."""


def object_log_odds(
    cloud: Cloud, candidates: Sequence[Candidate], object_m: float, config: LabelConfig
) -> Float32[np.ndarray, "n k"]:
    """Unary potentials of all objects, as log-odds against the background.

    All sources of an object train one classifier together, so several views of an object help each other.

    Args:
        cloud: the points.
        candidates: the objects.
        object_m: size of a typical object, metres.
        config: settings.

    Returns:
        Log-odds per point and object.
    """
    log_odds = np.full((cloud.num_points, len(candidates)), FAR_LOG_ODDS, np.float32)
    for k, candidate in enumerate(candidates):
        rng = np.random.default_rng([config.seed, k])
        _one_object(cloud, candidate, object_m, config, rng, log_odds[:, k])
    return log_odds


def _one_object(cloud: Cloud, candidate: Candidate, object_m, config: LabelConfig, rng, log_odds) -> None:
    support, denial, rim = _votes(cloud.num_points, candidate, config.weak_evidence)
    front = np.flatnonzero(support > denial)
    if len(front) == 0:
        return
    centre, near = _neighbourhood(cloud, front, config.crop * object_m)
    back = np.flatnonzero(near & (denial >= support) & (denial > 0))
    reachable = np.flatnonzero(near)
    votes = _vote_log_odds(support, denial, candidate)
    log_odds[reachable] = votes[reachable]
    if len(back) == 0:
        return
    hard = _sample(back[rim[back]], config.svm_samples // 2, rng)
    easy = _sample(back, config.svm_samples - len(hard), rng)
    features = np.concatenate([cloud.colours, cloud.points - centre], axis=1)
    unary = train_unary(features[_sample(front, config.svm_samples, rng)], features[np.concatenate([hard, easy])], rng)
    log_odds[reachable] += np.clip(unary.log_odds(features[reachable]), -MAX_LOG_ODDS, MAX_LOG_ODDS)


def _votes(num_points: int, candidate: Candidate, weak: bool):
    """Confidence-weighted votes for and against every point, and the hard rim around the masks."""
    support, denial = np.zeros(num_points, np.float32), np.zeros(num_points, np.float32)
    rim = np.zeros(num_points, bool)
    for evidence in [*candidate.sources, *(candidate.weak if weak else [])]:
        support[evidence.foreground] += evidence.detection.confidence
        denial[evidence.background] += evidence.detection.confidence
        rim[evidence.rim] = True
    return support, denial, rim


def _vote_log_odds(support, denial, candidate: Candidate) -> Float32[np.ndarray, "n"]:
    """Votes as log-odds: an honest score is the chance that a vote is right."""
    total = support + denial
    balance = (support - denial) / np.maximum(total, 1e-9)
    confidence = np.mean([source.detection.confidence for source in candidate.sources])
    reliability = float(np.clip(confidence, 0.5, 0.99))
    strength = np.sqrt(np.minimum(total, MAX_VOTES)) * np.log(reliability / (1 - reliability))
    return (balance * strength).astype(np.float32)


def _neighbourhood(cloud: Cloud, front, margin_m: float) -> tuple[Float32[np.ndarray, "3"], Bool[np.ndarray, "n"]]:
    """Centre of the seeds, and the points within a box around them grown by a margin."""
    seeds = cloud.points[front]
    centre = np.median(seeds, axis=0)
    half = np.quantile(np.abs(seeds - centre), 0.98, axis=0) + margin_m
    return centre, np.all(np.abs(cloud.points - centre) <= half, axis=1)


def _sample(members, count: int, rng: np.random.Generator):
    return rng.choice(members, min(count, len(members)), replace=False)
