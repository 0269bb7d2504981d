"""Labels where things move: the same starts with things that move and with the same things standing still."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from labeling.generator.settings.label_config import LabelConfig

if TYPE_CHECKING:
    from experiments.cache.episode_pool import EpisodePool
    from labeling.metrics.matching import MaskInstance

STILL, MOVING = "standing", "moving"
"""How things that can move do."""
DETECTOR, THESIS, OURS = "detector", "all stands still", "things move"
"""Whose masks are scored: the detector's, and labels made without and with --moving."""
PARTS = ("all", "movers", "others")
"""Which objects count; the others are ignored then."""


@dataclass(frozen=True)
class World:
    """Where it is tried."""

    env: str
    moving: int
    """Things that move, at most."""


WORLDS: Mapping[str, World] = MappingProxyType(
    {"rooms": World("sbm_gym/Indoor-v0", 3), "streets": World("sbm_gym/Outdoor-v0", 4)}
)
EPISODES: dict[Scale, int] = {"smoke": 1, "quick": 16, "standard": 32, "full": 60}
SEED = 31
"""Of scenes and starts. Settings were chosen on ten endless scenes of another seed."""
FIGURES = ("mask_ap50", "mean_iou")


@experiment(
    "moving_labels",
    "labels of endless scenes in which things move, beside the same scenes in which these stand",
    pages=("moving_labels",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records both kinds of episodes in both worlds and labels them with and without ``--moving``.

    Returns:
        For each world the pools, how many objects move, and figures by whether things move, by whose masks and by part:
        ``mean`` over episodes, ``pooled``, ``per_episode``; for the labels of --moving also ``gain`` (paired, over
        those without it) and, where things move, ``kept`` (paired difference from where they stand).
    """
    return {"worlds": {name: _one_world(name, world, context) for name, world in WORLDS.items()}}


def pools_of(name: str, world: World, scale: Scale) -> "dict[str, EpisodePool]":
    """Where things stand, and where they move."""
    from experiments.cache.episode_pool import EpisodePool

    common = EpisodePool(f"{name}_moving", world.env, "endless", EPISODES[scale], SEED, "compact", moving=world.moving)
    return {STILL: replace(common, name=f"{name}_standing", moving_speed=0.0), MOVING: common}


def _one_world(name: str, world: World, context: RunContext) -> dict[str, Any]:
    from agents.evaluation.statistics import paired_record
    from experiments.ablations.label_scores import Setting, score_all
    from experiments.cache.episode_pool import pool_record, record

    treatments = {
        DETECTOR: [Setting(None)],
        THESIS: [Setting(LabelConfig(moving=False, seed=seed)) for seed in context.seeds],
        OURS: [Setting(LabelConfig(seed=seed)) for seed in context.seeds],
    }
    pools = pools_of(name, world, context.scale)
    found: dict[str, Any] = {}
    about: dict[str, Any] = {}
    movers: dict[str, int] = {}
    for motion, pool in pools.items():
        folders = record(pool, context)
        about[motion] = pool_record(pool, folders)
        truths = [_truths(folder) for folder in folders]
        movers[motion] = sum(len(one["moving ids"]) for one in truths)
        rows = iter(score_all(folders, [one for own in treatments.values() for one in own], context, "moving"))
        found[motion] = {}
        for treatment, settings in treatments.items():
            scored = [[list(one.predictions) for one in next(rows)] for _ in settings]
            found[motion][treatment] = {part: _figures(scored, [one[part] for one in truths]) for part in PARTS}
    for motion, part in ((motion, part) for motion in pools for part in PARTS):
        scenes = about[motion]["scenes"]
        ours = found[motion][OURS][part]
        theirs = found[motion][THESIS][part]["per_episode"]
        ours["gain"] = {one: paired_record(ours["per_episode"][one], theirs[one], scenes) for one in FIGURES}
        still = found[STILL][OURS][part]
        if motion == MOVING:
            ours["kept"] = {
                one: paired_record(ours["per_episode"][one], still["per_episode"][one], scenes) for one in FIGURES
            }
    return {"pools": about, "movers": movers, "results": found}


def _truths(folder: Path) -> dict[str, Any]:
    """Ground truth of an episode by part; what is not in a part is to be ignored in it."""
    from experiments.ablations.label_scores import known_truths
    from labeling.io.episodes import read_episode

    episode = read_episode(folder)
    moving = {one.instance_id for one in episode.motion or ()}
    parts: dict[str, Any] = {"all": known_truths(episode, folder.name)}
    of_movers = replace(episode, ground_truth=tuple(_ignored(episode.ground_truth or (), moving, False)))
    of_others = replace(episode, ground_truth=tuple(_ignored(episode.ground_truth or (), moving, True)))
    parts["movers"], parts["others"] = (known_truths(one, folder.name) for one in (of_movers, of_others))
    known = {one.instance_id for one in episode.ground_truth or ()}
    return {**parts, "moving ids": moving & known}


def _ignored(truths: Sequence[Any], ids: set[int], those: bool) -> list[Any]:
    """Ground truth of which those with these ids (or all others) are ignored."""
    return [replace(one, ignore=one.ignore or ((one.instance_id in ids) == those)) for one in truths]


def _figures(seeds: "Sequence[Sequence[list[MaskInstance]]]", truths: "Sequence[list[MaskInstance]]") -> dict[str, Any]:
    """Figures of every episode, averaged over seeds, their mean, and those of all episodes ranked together."""
    from agents.evaluation.statistics import rounded
    from labeling.metrics.average_precision import mean_of

    every = [[_score(found, true) for found, true in zip(one, truths, strict=True)] for one in seeds]
    together = [true for one in truths for true in one]
    pooled = [_score([found for episode in one for found in episode], together) for one in seeds]
    per_episode = {
        figure: [rounded(mean_of([one[figure] for one in episode])) for episode in zip(*every, strict=True)]
        for figure in FIGURES
    }
    return {
        "mean": {figure: rounded(mean_of(values)) for figure, values in per_episode.items()},
        "pooled": {figure: rounded(mean_of([one[figure] for one in pooled])) for figure in FIGURES},
        "per_episode": per_episode,
    }


def _score(found: "list[MaskInstance]", truths: "list[MaskInstance]") -> dict[str, float | None]:
    from labeling.metrics.mask_ap import average_precision
    from labeling.metrics.matching import match, mean_iou

    if all(one.ignore for one in truths):
        return dict.fromkeys(FIGURES)
    return {
        "mask_ap50": average_precision(found, truths, (0.5,)).mean[0.5],
        "mean_iou": mean_iou(truths, match(found, truths)).mean_iou,
    }
