"""What a detector learns from the labels of each policy: as many episodes of each, the same training for all."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from experiments.cache import worlds
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES, WORLDS

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

POLICIES = ("ring", "next_best_view", "ppo")
"""Differences are to the first. ``ppo`` is the one that comes with the project, where there is one."""


@experiment(
    "policies",
    "compact fine-tuned on the labels of each policy's views of training scenes, tested on validation scenes",
    pages=("policies",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores; episodes, settings and validation pictures are those of ``fine_tuning``.

    Returns:
        For each world: the episodes, how good the labels are, the detector before, and every run by policy and seed.
    """
    size = SIZES[context.scale]
    photographs = worlds.source_photographs(size.photographs, context)
    return {
        "compared_with": POLICIES[0],
        "detector": DETECTOR,
        "settings": size.settings(*size.episodes),
        "worlds": {world: _one_world(world, photographs, context) for world in size.episodes},
    }


def _one_world(world: str, photographs: "Sequence[list[AnnotatedPicture]]", context: RunContext) -> dict[str, Any]:
    from experiments.cache.detector_stages import TrainJob, make_labels, score_labels, train_and_score
    from experiments.cache.episode_pool import EpisodePool, pool_record, record
    from experiments.tables.policy_evaluation import available_policies, training_of
    from labeling.detectors.data.annotated_pictures import read_pictures

    size, env_id, (replay, held_out) = SIZES[context.scale], WORLDS[world], photographs
    learn, choose, val = size.episodes[world]
    policies, left_out = available_policies(env_id, POLICIES)
    val_pool = EpisodePool(f"{world}_val", env_id, "val", val, 0, DETECTOR)
    val_folders = record(val_pool, context)
    pools, labels, runs = {"val": pool_record(val_pool, val_folders)}, [], []
    for policy in policies:
        folders = {}
        for seed, (name, count) in enumerate((("learn", learn), ("choose", choose))):
            pool = EpisodePool(f"{world}_{name}", env_id, "train", count, seed, DETECTOR, policy)
            folders[name] = record(pool, context)
            pools[f"{policy}_{name}"] = pool_record(pool, folders[name])
        for seed in context.seeds:
            made = {name: make_labels(found, seed, context) for name, found in folders.items()}
            labels.append({"policy": policy, "seed": seed, **score_labels(made["learn"])})
            pictures = {name: read_pictures(one) for name, one in made.items()}
            title, how = f"labels of {policy} in {world}", (size.train, size.augment[world])
            job = TrainJob(DETECTOR, pictures["learn"], pictures["choose"], replay, *how, seed, title)
            runs.append(({"policy": policy, "seed": seed}, job))
    sets = {"validation": read_pictures(val_folders[0].parent), "photographs": held_out}
    return {
        "pools": pools,
        "left_out": left_out,
        "trained": training_of(policies, env_id),
        "labels": labels,
        **train_and_score(runs, DETECTOR, sets, context),
    }
