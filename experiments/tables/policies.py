"""What a detector learns from the labels of each policy: as many episodes of each, the same training for all."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cache.stages import Workplace

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

DESCRIPTION = "compact fine-tuned on the labels of each policy's views of training scenes, tried on validation scenes"
POLICIES = ("ring", "next_best_view", "ppo")
"""Differences are to the first. ``ppo`` is the one that comes with the project, where there is one."""


def run(workplace: Workplace) -> dict[str, Any]:
    """Records, labels, trains and scores; episodes, settings and validation pictures are those of ``fine_tuning``.

    Returns:
        For each world: the episodes, how good the labels are, the detector before, and every run by policy and seed.
    """
    from experiments.cache.worlds import DETECTOR
    from experiments.tables.fine_tuning import SIZES, replayed_photographs

    size = SIZES[workplace.scale]
    photographs = replayed_photographs(size.photographs, workplace)
    return {
        "compared_with": POLICIES[0],
        "detector": DETECTOR,
        "settings": {
            "train": asdict(size.train),
            "augment": {world: asdict(size.augment[world]) for world in size.episodes},
            "photographs": size.photographs,
        },
        "worlds": {world: _one_world(world, photographs, workplace) for world in size.episodes},
    }


def _one_world(world: str, photographs: "Sequence[Sequence[AnnotatedPicture]]", workplace: Workplace) -> dict[str, Any]:
    from experiments.cache.detector_stages import Course, detector_scores, label, label_scores, taught
    from experiments.cache.episode_pool import Pool, about, record
    from experiments.cache.worlds import DETECTOR, WORLDS
    from experiments.tables.fine_tuning import SIZES
    from experiments.tables.policy_evaluation import present, trained
    from labeling.detectors.data.annotated_pictures import read_pictures

    size, env_id = SIZES[workplace.scale], WORLDS[world]
    learn, choose, val = size.episodes[world]
    policies, left_out = present(env_id, POLICIES)
    val_pool = Pool(f"{world}_val", env_id, "val", val, 0, DETECTOR)
    val_folders = record(val_pool, workplace)
    replay, held_out = photographs
    sets = {"validation": read_pictures(val_folders[0].parent), "photographs": held_out}
    pools, labels, courses = {"val": about(val_pool, val_folders)}, [], []
    for policy in policies:
        folders: dict[str, list[Path]] = {}
        for seed, (name, count) in enumerate((("learn", learn), ("choose", choose))):
            pool = Pool(f"{world}_{name}", env_id, "train", count, seed, DETECTOR, policy)
            folders[name] = record(pool, workplace)
            pools[f"{policy}_{name}"] = about(pool, folders[name])
        for seed in workplace.seeds:
            made = {name: label(found, seed, workplace) for name, found in folders.items()}
            labels.append({"policy": policy, "seed": seed, **label_scores(made["learn"])})
            taken, chosen_by = (read_pictures(made[name]) for name in ("learn", "choose"))
            title = f"labels of {policy} in {world}"
            courses.append(Course(DETECTOR, taken, chosen_by, replay, size.train, size.augment[world], seed, title))
    before, *after = detector_scores([DETECTOR, *taught(courses, workplace)], sets, workplace)
    who = [{"policy": policy, "seed": seed} for policy in policies for seed in workplace.seeds]
    return {
        "pools": pools,
        "left_out": left_out,
        "trained": trained(policies, env_id),
        "labels": labels,
        "before": before,
        "runs": [{**one, **scores} for one, scores in zip(who, after, strict=True)],
    }


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about policies, and the pictures in it.

    Returns:
        The files written.
    """
    from experiments.pages.policies import write_page

    return write_page(results, docs)
