"""The thesis' table 5.5 in our streets, and the same in rooms: 3-D boxes without a human label, on unseen scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.cache.box_stages import (
    BoxEvaluation,
    MaskSource,
    TrainJob3d,
    score_box_targets,
    score_boxes,
    train_detectors_3d,
)
from experiments.cache.origin import MACHINES, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.cache.worlds import DETECTOR
from experiments.tables.training_sets import Subset, TrainingSets, known_categories
from labeling.detectors3d.config import Augment3dConfig, Train3dConfig

LDLS, TUNED, CEILING = "LDLS", "LDLS, tuned", "supervised F-PointNet"
OURS, SHARED = "SbM F-PointNet", "SbM F-PointNet on shared labels"
RECIPES = {OURS: "sbm", SHARED: "shared"}
"""What labels networks learn from; the supervised one learns from ground truth of the same views."""
NETWORKS = (*RECIPES, CEILING)
ROWS = (LDLS, TUNED, *NETWORKS)
MASK_SOURCES: tuple[MaskSource, ...] = ("recorded", "told")
TEST_SUBSET: Subset = "wide"
"""The thesis' single test town and two test homes have too few objects to tell networks apart."""
SCALES_M = (0.03, 0.1, 0.3, 1.0)
"""Distances over which LDLS weighs neighbours, of which its tuned row takes the best. As published: 1 m."""


TRAIN: dict[Scale, Train3dConfig] = {
    "smoke": Train3dConfig(iterations=4, batch_size=4, num_points=64, width=0.1, validate_every=2),
    "quick": Train3dConfig(iterations=1000, num_points=512, width=0.5, validate_every=100, patience=0),
    "standard": Train3dConfig(iterations=4000, width=0.5, validate_every=400),
    "full": Train3dConfig(iterations=20_000, validate_every=500),
}
AUGMENT = Augment3dConfig()


ABOUT = "3-D boxes on unseen {}: LDLS, and frustum PointNets trained on SbM labels and on ground truth"


@experiment("table_5_5", ABOUT.format("towns"), pages=("results",))
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores in streets, as the thesis does; see ``boxes_in``."""
    return boxes_in("streets", context)


@experiment("table_5_5_rooms", ABOUT.format("homes"), pages=("results",))
def run_rooms(context: RunContext) -> dict[str, Any]:
    """The same in rooms."""
    return boxes_in("rooms", context)


def boxes_in(world: str, context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores.

    Args:
        world: one of ``experiments.cache.worlds.WORLDS``.
        context: scale, seeds, workers and cache.

    Returns:
        For the world: the episodes, and by row and by where masks come from the figures of each seed.
    """
    train = TRAIN[context.scale]
    found = _one_world(world, train, context)
    return {
        "settings": {"train": asdict(train), "augment": asdict(AUGMENT), "ldls_scales_m": SCALES_M},
        "finder": DETECTOR,
        MACHINES: found[MACHINES],
        "worlds": {world: found},
    }


def _one_world(world: str, train: Train3dConfig, context: RunContext) -> dict[str, Any]:
    sets = TrainingSets(world, context)
    subsets: tuple[Subset, ...] = ("learn", "choose", TEST_SUBSET)
    episodes = {subset: sets.episodes(subset) for subset in subsets}
    categories = known_categories()
    students = [(row, seed) for row in NETWORKS for seed in context.seeds]
    jobs = [train_job(row, sets, seed, categories, train) for row, seed in students]
    networks = dict(zip(students, train_detectors_3d(jobs, context), strict=True))
    ldls_ap25 = ldls_ap25_by_scale(world, episodes["choose"], categories, context)
    detectors: dict[str, list[tuple[int | None, str]]] = {
        LDLS: [(None, "ldls")],
        TUNED: [(None, best_ldls(ldls_ap25))],
        **{row: [(seed, networks[row, seed]) for seed in context.seeds] for row in NETWORKS},
    }
    test = tuple(episodes[TEST_SUBSET])
    wanted: list[tuple[str, MaskSource]] = [(row, masks) for row in ROWS for masks in MASK_SOURCES]
    evaluations = [
        BoxEvaluation(world, test, name, masks, categories) for row, masks in wanted for _, name in detectors[row]
    ]
    scores = iter(score_boxes(evaluations, context))  # of all at once, which is in parallel
    rows = [
        {"name": row, "boxes": masks, "runs": [{"seed": seed, **next(scores)} for seed, _ in detectors[row]]}
        for row, masks in wanted
    ]
    return {
        "categories": list(categories),
        "pools": {subset: sets.pool_record(subset) for subset in subsets},
        "ldls_ap25_by_scale_m": {str(scale): ap25 for scale, ap25 in ldls_ap25.items()},
        "rows": rows,
        "targets": {
            row: score_box_targets([sets.labels("learn", recipe, n) for n in context.seeds], episodes["learn"], context)
            for row, recipe in RECIPES.items()
        },
        "training": histories(list(networks.values()), jobs),
        MACHINES: machines(networks.values()),
    }


def ldls_ap25_by_scale(
    world: str, episodes: Sequence[Path], categories: tuple[str, ...], context: RunContext
) -> dict[float, float]:
    """AP25 of LDLS by the distance over which it weighs neighbours, of training scenes that no network learns from."""
    names = [f"ldls:{scale}" for scale in SCALES_M]
    evaluations = [BoxEvaluation(world, tuple(episodes), name, "recorded", categories) for name in names]
    found = score_boxes(evaluations, context)
    return {scale: figures["ap25"] or 0.0 for scale, figures in zip(SCALES_M, found, strict=True)}


def best_ldls(ap25: Mapping[float, float]) -> str:
    """Name of LDLS with the best distance."""
    return f"ldls:{max(ap25, key=lambda scale: ap25[scale])}"


def train_job(
    title: str, sets: TrainingSets, seed: int, categories: tuple[str, ...], train: Train3dConfig
) -> TrainJob3d:
    """The training of the frustum PointNet of a row."""
    subsets: tuple[Subset, Subset] = ("learn", "choose")
    if title in RECIPES:
        learn, choose = (sets.labels(subset, RECIPES[title], seed) for subset in subsets)
    else:
        learn, choose = (sets.episodes(subset)[0].parent for subset in subsets)
    return TrainJob3d(learn, choose, categories, train, AUGMENT, seed, f"{title} of {sets.world}")


def sbm_network(world: str, seed: int, context: RunContext) -> tuple[str, tuple[str, ...]]:
    """The frustum PointNet that was trained on shared SbM labels, and its categories."""
    categories = known_categories()
    job = train_job(SHARED, TrainingSets(world, context), seed, categories, TRAIN[context.scale])
    return train_detectors_3d([job], context)[0], categories


def histories(networks: Sequence[str], jobs: Sequence[TrainJob3d]) -> list[dict[str, Any]]:
    """Validation curves."""
    from labeling.formats.checked_json import read_json
    from labeling.training.config import HISTORY_FILE

    found = []
    for folder, job in zip(networks, jobs, strict=True):
        history = read_json(Path(folder) / HISTORY_FILE).items()
        curve = [[one.integer("iteration"), one.number("mean_iou")] for one in history if one.has("mean_iou")]
        found.append({"title": job.title, "seed": job.seed, "mean_iou": curve})
    return found
