"""Boxes of unseen homes by the number of views: memories, frustum PointNets of one view, and these fused over views.

Trained on SbM labels and on ground truth of the same rooms as table 5.5, whose frustum PointNets these are.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from experiments.cache.box_stages import train_detectors_3d
from experiments.cache.egomotion import PairsToAlign, motion_errors
from experiments.cache.memory_box_stages import BoxJob, Looks, SceneScores, score_scenes, train_box_nets
from experiments.cache.origin import MACHINE, machine_of, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.tables import table_5_5
from experiments.tables.training_sets import Subset, TrainingSets, known_categories
from labeling.memory.settings.box_settings import TrainBoxesConfig
from labeling.memory.settings.memory_spec import MemorySize

WORLD, MODEL = "rooms", "cn3d"
LABELS = {"SbM labels": table_5_5.OURS, "ground truth": table_5_5.CEILING}
"""What is learnt from -> the row of table 5.5 that learns from it."""
LOOKS: dict[Looks, str] = {
    "one view": "F-PointNet, one view",
    "fused views": "F-PointNet, views fused",
    "memory": "memory of views",
    "memory, poses by ICP": "memory of views, poses by ICP",
}
PAIRS = 4
"""Of each episode to be tested on, in which the motion of the camera is estimated."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has; episodes are those of table 5.5."""

    memory: MemorySize
    train: TrainBoxesConfig
    inputs: tuple[int, ...] = (1, 2, 4, 8)


SIZES: dict[Scale, Size] = {
    "smoke": Size(
        MemorySize((16, 16, 8), 0.32, 8, 8, 8, (32, 32)),
        TrainBoxesConfig(iterations=4, validate_every=2, views=2),
        (1, 2),
    ),
    "quick": Size(MemorySize(), TrainBoxesConfig(iterations=1000, validate_every=200, patience=0)),
    "standard": Size(MemorySize(), TrainBoxesConfig(iterations=6000, validate_every=500)),
    "full": Size(
        MemorySize((64, 64, 32), 0.08, 32, 48, 64, (128, 128)),
        TrainBoxesConfig(iterations=40_000, validate_every=1000, batch_size=4),
    ),
}


@experiment(
    "memory_boxes",
    "3-D boxes of unseen homes from 1 to 8 views: a memory, frustum PointNets of one view, and these fused",
    pages=("memory.boxes",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores.

    Returns:
        Settings, the episodes, by method, labels and seed the figures by the number of views given, and errors of the
        motion of the camera where it is estimated.
    """
    size, sets = SIZES[context.scale], TrainingSets(WORLD, context)
    subsets: tuple[Subset, ...] = ("learn", "choose", table_5_5.TEST_SUBSET)
    episodes = {subset: sets.episodes(subset) for subset in subsets}
    categories = known_categories()
    frustum_train = table_5_5.TRAIN[context.scale]
    learners = [(labels, row, seed) for labels, row in LABELS.items() for seed in context.seeds]
    frustum_jobs = [table_5_5.train_job(row, sets, seed, categories, frustum_train) for _, row, seed in learners]
    box_jobs = [
        BoxJob(
            MODEL, (job.learn,), (job.choose,), size.memory, size.train, job.seed, f"memory, {labels}", None, categories
        )
        for (labels, _, _), job in zip(learners, frustum_jobs, strict=True)
    ]
    frustums, memories = train_detectors_3d(frustum_jobs, context), train_box_nets(box_jobs, context)
    methods: list[tuple[Looks, Sequence[str]]] = [
        ("one view", frustums),
        ("fused views", frustums),
        ("memory", memories),
        ("memory, poses by ICP", memories),
    ]
    test = tuple(episodes[table_5_5.TEST_SUBSET])
    wanted = [
        SceneScores(looks, run, test, size.memory, size.train.around, size.inputs, categories)
        for looks, runs in methods
        for run in runs
    ]
    named = [
        {"name": LOOKS[looks], "labels": labels, "seed": seed, MACHINE: machine_of(run)}
        for looks, runs in methods
        for (labels, _, seed), run in zip(learners, runs, strict=True)
    ]
    scores = score_scenes(wanted, context)
    motion = motion_errors([PairsToAlign(path, size.memory, size.train.around, PAIRS) for path in test], context)
    return {
        "settings": {
            "memory": asdict(size.memory),
            "model": MODEL,
            "train": asdict(size.train),
            "frustums": asdict(frustum_train),
            "inputs": list(size.inputs),
        },
        "finder": table_5_5.DETECTOR,
        "categories": list(categories),
        "pools": {subset: sets.pool_record(subset) for subset in subsets},
        "machines": machines([*frustums, *memories]),
        "rows": [{**row, **found} for row, found in zip(named, scores, strict=True)],
        "motion": motion,
        "training": histories(box_jobs, memories),
    }


def histories(jobs: Sequence[BoxJob], runs: Sequence[str]) -> list[dict[str, Any]]:
    """Validation curves of networks that were chosen by their AP."""
    from pathlib import Path

    from labeling.formats.checked_json import read_json
    from labeling.training.config import HISTORY_FILE

    found = []
    for job, folder in zip(jobs, runs, strict=True):
        history = read_json(Path(folder) / HISTORY_FILE).items()
        curve = [[one.integer("iteration"), one.number("ap25")] for one in history if one.has("ap25")]
        found.append({"title": job.title, "seed": job.seed, "ap25": curve})
    return found
