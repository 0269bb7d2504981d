"""Log-odds of every object at every point: the direct votes of its sources, and a classifier trained on them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.objects.seeds import DetectionSeeds
from labeling.generator.segment.gaussian_classifier import MAX_LOG_ODDS, train_classifier, train_gaussian_classifier
from labeling.generator.segment.training_points import crop_around, sample_background, sample_foreground
from labeling.generator.settings.label_config import LabelConfig

UNREACHABLE_LOG_ODDS = -8.0
"""Given to points out of an object's reach: they can never join it."""
MAX_VOTES = 3.0
"""Sum of confidences at which more views of the same point stop adding weight: their errors are not independent."""


def object_log_odds(
    cloud: Cloud,
    candidates: Sequence[Candidate],
    config: LabelConfig,
    numbers: Sequence[int] | None = None,
) -> Float32[np.ndarray, "n k"]:
    """Unary potentials of all objects, as log-odds against the background.

    All sources of an object train one classifier together, so several views of an object help each other.

    Args:
        cloud: the points.
        candidates: the objects.
        config: settings.
        numbers: of the objects; each chooses the training points of its own. By default 0, 1 and so on.

    Returns:
        Log-odds per point and object, object after object in memory.
    """
    columns = np.full((len(candidates), cloud.num_points), UNREACHABLE_LOG_ODDS, np.float32)
    for k, candidate in enumerate(candidates):
        rng = np.random.default_rng([config.seed, k if numbers is None else numbers[k]])
        _one_object(cloud, candidate, config, rng, columns[k])
    return columns.T


def _one_object(cloud: Cloud, candidate: Candidate, config: LabelConfig, rng, log_odds) -> None:
    """Fills the column ``log_odds`` (n,) of one object in place."""
    votes_for, votes_against = _votes(cloud.num_points, candidate, config)
    foreground = np.flatnonzero(votes_for > votes_against)
    if len(foreground) == 0:
        return
    against = (votes_against >= votes_for) & (votes_against > 0)
    is_cut = candidate.is_cut
    centre, inside = crop_around(cloud, foreground, against, candidate.size_m(cloud.voxel_m), config, is_cut)
    background = np.flatnonzero(inside & against)
    reachable = np.flatnonzero(inside)
    decided = np.zeros(len(reachable), np.float32)
    if config.votes:
        decided = _vote_log_odds(votes_for[reachable], votes_against[reachable], candidate, config)
    if len(background) > 0:
        hard = _hard_negatives(cloud.num_points, candidate, config)
        features = _features(cloud, reachable, centre)
        if config.gaussian_share >= 1 and config.outer_share == 0:
            seeds = votes_for[reachable] > votes_against[reachable], against[reachable]
            classifier = train_gaussian_classifier(features[seeds[0]], features[seeds[1]], hard[background])
        else:
            negatives = sample_background(background, hard, rng)
            positives = sample_foreground(cloud.points, foreground, centre, config, rng)
            classifier = train_classifier(
                _features(cloud, positives, centre), _features(cloud, negatives, centre), rng, config.gaussian_share
            )
        odds = np.clip(classifier.log_odds(features), -MAX_LOG_ODDS, MAX_LOG_ODDS)
        if is_cut and config.colour_beyond > 0:
            # Beyond the border of the picture seeds do not show where the object ends, but they show its colours.
            own, other = votes_for[reachable] > votes_against[reachable], against[reachable]
            beyond = (votes_for + votes_against)[reachable] == 0
            colours = features[:, :3]
            by_colour = train_gaussian_classifier(colours[own], colours[other], hard[background])
            alike = np.clip(by_colour.log_odds(colours[beyond]), -MAX_LOG_ODDS, MAX_LOG_ODDS)
            odds[beyond] += np.float32(config.colour_beyond) * (alike - odds[beyond])
        decided += odds
    log_odds[reachable] = decided
    if config.clamp_seeds:
        log_odds[foreground[inside[foreground]]] = MAX_LOG_ODDS
        log_odds[background] = -MAX_LOG_ODDS


def _features(cloud: Cloud, rows, centre) -> Float32[np.ndarray, "n 6"]:
    """Colour and position of some points."""
    return np.concatenate([cloud.colours[rows], cloud.points[rows] - centre], axis=1)


def _votes(num_points: int, candidate: Candidate, config: LabelConfig):
    """Confidence-weighted votes for and against every point."""
    used = _used(candidate, config)
    if len(used) < len(candidate.sources):
        votes_for, votes_against = np.zeros(num_points, np.float32), np.zeros(num_points, np.float32)
    else:
        votes_for, votes_against = candidate.votes_for.copy(), candidate.votes_against.copy()
        used = used[len(candidate.sources) :]
    for seeds in used:
        votes_for[seeds.foreground] += seeds.detection.confidence
        votes_against[seeds.background] += seeds.detection.confidence
    return votes_for, votes_against


def _hard_negatives(num_points: int, candidate: Candidate, config: LabelConfig) -> Bool[np.ndarray, "n"]:
    """The background next to the masks."""
    hard = np.zeros(num_points, bool)
    for seeds in _used(candidate, config):
        hard[seeds.hard_negatives] = True
    return hard


def _used(candidate: Candidate, config: LabelConfig) -> list[DetectionSeeds]:
    """The detections that an object is segmented from: its sources first."""
    sources = candidate.sources
    if config.max_sources and config.max_sources < len(sources):
        sources = sorted(sources, key=lambda one: -one.detection.confidence)[: config.max_sources]
    return [*sources, *(candidate.weak if config.weak_evidence else [])]


def _vote_log_odds(votes_for, votes_against, candidate: Candidate, config: LabelConfig) -> Float32[np.ndarray, "n"]:
    """Votes as log-odds: the mean confidence of the sources is taken as the probability that a vote is right; where
    none of them is confident, at least ``min_vote``.
    """
    total = votes_for + votes_against
    balance = (votes_for - votes_against) / np.maximum(total, 1e-9)
    confidences = [source.detection.confidence for source in candidate.sources]
    least = 0.5 if max(confidences) >= config.confident else config.min_vote
    chance = float(np.clip(np.mean(confidences), least, 0.99))
    strength = np.sqrt(np.minimum(total, MAX_VOTES)) * np.log(chance / (1 - chance))
    return (balance * strength).astype(np.float32)
