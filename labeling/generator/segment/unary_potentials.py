"""Log-odds of every object at every point: the direct votes of its sources, and a classifier trained on them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.segment.gaussian_classifier import train_classifier
from labeling.generator.segment.training_points import crop_around, sample_background, sample_foreground
from labeling.generator.settings.label_config import LabelConfig
from labeling.runtime.threads import in_threads

UNREACHABLE_LOG_ODDS = -8.0
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
    log_odds = np.full((cloud.num_points, len(candidates)), UNREACHABLE_LOG_ODDS, np.float32)

    def fill_column(k: int) -> None:
        rng = np.random.default_rng([config.seed, k])
        _one_object(cloud, candidates[k], object_m, config, rng, log_odds[:, k])

    in_threads(fill_column, range(len(candidates)))
    return log_odds


def _one_object(cloud: Cloud, candidate: Candidate, object_m, config: LabelConfig, rng, log_odds) -> None:
    """Fills the column ``log_odds`` (n,) of one object in place."""
    votes_for, votes_against, hard = _votes(cloud.num_points, candidate, config)
    foreground = np.flatnonzero(votes_for > votes_against)
    if len(foreground) == 0:
        return
    against = (votes_against >= votes_for) & (votes_against > 0)
    centre, inside = crop_around(cloud, foreground, against, object_m, config)
    background = np.flatnonzero(inside & against)
    reachable = np.flatnonzero(inside)
    log_odds[reachable] = _vote_log_odds(votes_for, votes_against, candidate)[reachable] if config.votes else 0.0
    if len(background) > 0:
        negatives = sample_background(background, hard, rng)
        positives = sample_foreground(cloud.points, foreground, centre, config, rng)
        classifier = train_classifier(
            _features(cloud, positives, centre), _features(cloud, negatives, centre), rng, config.gaussian_share
        )
        decided = classifier.log_odds(_features(cloud, reachable, centre))
        log_odds[reachable] += np.clip(decided, -MAX_LOG_ODDS, MAX_LOG_ODDS)
    if config.clamp_seeds:
        log_odds[foreground[inside[foreground]]] = MAX_LOG_ODDS
        log_odds[background] = -MAX_LOG_ODDS


def _features(cloud: Cloud, rows, centre) -> Float32[np.ndarray, "n 6"]:
    """Colour and position of some points."""
    return np.concatenate([cloud.colours[rows], cloud.points[rows] - centre], axis=1)


def _votes(num_points: int, candidate: Candidate, config: LabelConfig):
    """Confidence-weighted votes for and against every point, and the background next to the masks."""
    votes_for, votes_against = np.zeros(num_points, np.float32), np.zeros(num_points, np.float32)
    hard = np.zeros(num_points, bool)
    sources = candidate.sources
    if config.max_sources:
        sources = sorted(sources, key=lambda one: -one.detection.confidence)[: config.max_sources]
    for seeds in [*sources, *(candidate.weak if config.weak_evidence else [])]:
        votes_for[seeds.foreground] += seeds.detection.confidence
        votes_against[seeds.background] += seeds.detection.confidence
        hard[seeds.hard_negatives] = True
    return votes_for, votes_against, hard


def _vote_log_odds(votes_for, votes_against, candidate: Candidate) -> Float32[np.ndarray, "n"]:
    """Votes as log-odds: an honest score is the chance that a vote is right."""
    total = votes_for + votes_against
    balance = (votes_for - votes_against) / np.maximum(total, 1e-9)
    confidence = np.mean([source.detection.confidence for source in candidate.sources])
    reliability = float(np.clip(confidence, 0.5, 0.99))
    strength = np.sqrt(np.minimum(total, MAX_VOTES)) * np.log(reliability / (1 - reliability))
    return (balance * strength).astype(np.float32)
