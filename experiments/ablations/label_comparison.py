"""Label settings side by side on the same episodes: figures, and paired differences from one of them."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from agents.evaluation.statistics import paired_record, rounded
from experiments.ablations.label_scores import FIGURES, Scored, Setting, pooled_figures, score_all, true_instances
from experiments.cache.episode_pool import EpisodePool, pool_record, record
from experiments.cache.stages import RunContext
from labeling.metrics.average_precision import mean_of
from labeling.metrics.matching import MaskInstance


def compare(
    named: Mapping[str, Sequence[Setting]], base: str, pools: Sequence[EpisodePool], context: RunContext, title: str
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Records the pools, labels them under all settings and compares.

    Args:
        named: settings by name, one for each seed.
        base: name of the settings that the others are compared with.
        pools: where.
        context: scale, store, processes.
        title: of the progress bar.

    Returns:
        What the pools are, and by name and pool: ``mean`` over episodes, ``pooled`` over all their labels,
        ``per_episode``, ``difference`` from the base (``paired_record``) and ``cpu_s`` per episode.

    Raises:
        SbmError: if recording or labelling fails.
    """
    folders = {pool.name: record(pool, context) for pool in pools}
    about = {pool.name: pool_record(pool, folders[pool.name]) for pool in pools}
    every_setting = [one for settings in named.values() for one in settings]
    every = [folder for found in folders.values() for folder in found]
    rows = iter(score_all(every, every_setting, context, title))
    scored = {name: [next(rows) for _ in settings] for name, settings in named.items()}
    results: dict[str, Any] = {name: {} for name in named}
    start = 0
    for pool in pools:
        part = slice(start, start + len(folders[pool.name]))
        start = part.stop
        episodes = {name: [row[part] for row in seeds] for name, seeds in scored.items()}
        reference = _per_episode(episodes[base])
        truths = true_instances(folders[pool.name])
        scenes = about[pool.name]["scenes"]
        for name, seeds in episodes.items():
            results[name][pool.name] = _summary(truths, seeds, reference, scenes)
    return about, results


def _per_episode(seeds: Sequence[Sequence[Scored]]) -> dict[str, list[float | None]]:
    """Every figure of every episode, averaged over the seeds."""
    return {
        figure: [mean_of([one.figures[figure] for one in episode]) for episode in zip(*seeds, strict=True)]
        for figure in FIGURES
    }


def _summary(
    truths: list[MaskInstance], seeds: list[list[Scored]], reference: dict[str, Any], scenes: Sequence[str]
) -> dict[str, Any]:
    found = _per_episode(seeds)
    pooled = [pooled_figures(truths, one) for one in seeds]
    return {
        "mean": {figure: rounded(mean_of(found[figure])) for figure in FIGURES},
        "pooled": {figure: rounded(mean_of([one[figure] for one in pooled])) for figure in pooled[0]},
        "per_episode": {figure: [rounded(value) for value in found[figure]] for figure in FIGURES},
        "difference": {figure: paired_record(found[figure], reference[figure], scenes) for figure in FIGURES},
        "cpu_s": rounded(median(one.cpu_s for seed in seeds for one in seed)),
        "objects": [mean_of([one.objects for one in episode]) for episode in zip(*seeds, strict=True)],
    }
