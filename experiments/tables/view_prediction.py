"""Predicted views of rooms of two and of four objects, learnt on two: memories in 3-D, a 2-D network, reprojection.

The thesis' claim (2.6) and the protocol of Tung et al. 2019: train on scenes of two objects, test on two and on four.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from experiments.cache.memory_stages import REPROJECTION, MemoryJob, ViewScores, score_views, train_memories
from experiments.cache.object_rooms import ObjectRooms, record_object_rooms
from experiments.cache.origin import MACHINE, machine_of, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from labeling.memory.settings.memory_spec import MemorySize, Model
from labeling.memory.settings.train_config import TrainMemoryConfig

GRNN, CN3D, TOWER, NOTHING_LEARNT = "GRNN", "C-N3D", "2-D tower", "depth reprojection"
MODELS: dict[str, Model] = {GRNN: "grnn", CN3D: "cn3d", TOWER: "tower"}
TRAINED_ON, TESTED_ON = 2, (2, 4)
"""Objects in a scene."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    learn: int
    """Scenes of two objects to learn from."""
    choose: int
    """Others of two objects, to choose the best network by."""
    test: int
    """Scenes of either number of objects to report on."""
    memory: MemorySize
    train: dict[str, TrainMemoryConfig]
    inputs: tuple[int, ...] = (1, 2, 4, 8)
    targets: int = 6
    """Views of each scene that are predicted."""


LONG = TrainMemoryConfig(iterations=1600, validate_every=200)
TRAIN = {GRNN: LONG, CN3D: LONG, TOWER: replace(LONG, iterations=6000, validate_every=500)}
"""About as long a time for each: a step of GRNN takes five of the tower's."""
SMALLEST = TrainMemoryConfig(iterations=4, validate_every=2, inputs=2, pairs=32)
SIZES: dict[Scale, Size] = {
    "smoke": Size(
        3, 1, 2, MemorySize((16, 16, 8), 0.32, 8, 8, 8, (32, 32)), dict.fromkeys(MODELS, SMALLEST), (1, 2), targets=2
    ),
    "quick": Size(150, 8, 24, MemorySize(), TRAIN),
    "standard": Size(
        500,
        16,
        48,
        MemorySize(),
        {name: replace(one, iterations=5 * one.iterations) for name, one in TRAIN.items()},
    ),
    "full": Size(
        1000,
        16,
        48,
        MemorySize((64, 64, 32), 0.08, 32, 48, 64, (128, 128)),
        {name: replace(one, iterations=40_000, validate_every=1000, batch_size=4) for name, one in TRAIN.items()},
    ),
}


@experiment(
    "view_prediction",
    "views of rooms of two and four objects from 1 to 8 others: GRNN, C-N3D, a 2-D network, depth reprojection",
    pages=("memory.view_prediction",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, trains and scores.

    Returns:
        Settings; by method, number of objects and seed the figures of predicted views by the number of inputs; and the
        validation curves.
    """
    size = SIZES[context.scale]
    test = {
        objects: tuple(record_object_rooms(ObjectRooms(objects, size.test, seed=2), context)) for objects in TESTED_ON
    }
    named = memory_jobs(context)
    jobs = [job for _, job in named]
    runs = train_memories(jobs, context)
    methods: list[tuple[str, int | None, str]] = [(NOTHING_LEARNT, None, REPROJECTION)]
    methods += [(name, job.seed, run) for (name, job), run in zip(named, runs, strict=True)]
    wanted = [
        ViewScores(method, test[objects], size.memory, size.inputs, size.targets)
        for _, _, method in methods
        for objects in TESTED_ON
    ]
    scores = iter(score_views(wanted, context))
    rows = [
        {
            "name": name,
            "seed": seed,
            MACHINE: None if method == REPROJECTION else machine_of(method),
            "objects": {str(objects): next(scores) for objects in TESTED_ON},
        }
        for name, seed, method in methods
    ]
    return {
        "settings": {
            "memory": asdict(size.memory),
            "train": {name: asdict(one) for name, one in size.train.items()},
            "scenes": {"learn": size.learn, "choose": size.choose, "test": size.test},
            "inputs": list(size.inputs),
            "targets": size.targets,
        },
        "machines": machines(runs),
        "rows": rows,
        "training": histories(jobs, runs),
    }


def memory_jobs(context: RunContext, names: Sequence[str] = tuple(MODELS)) -> list[tuple[str, MemoryJob]]:
    """Trainings of methods, one for each seed, on rooms that are recorded where they are missing."""
    size = SIZES[context.scale]
    learn = tuple(record_object_rooms(ObjectRooms(TRAINED_ON, size.learn), context))
    choose = tuple(record_object_rooms(ObjectRooms(TRAINED_ON, size.choose, seed=1), context))
    return [
        (name, MemoryJob(MODELS[name], learn, choose, size.memory, size.train[name], seed))
        for name in names
        for seed in context.seeds
    ]


def histories(jobs: list[MemoryJob], runs: list[str]) -> list[dict[str, Any]]:
    """Validation curves."""
    from pathlib import Path

    from labeling.formats.checked_json import read_json
    from labeling.training.config import HISTORY_FILE

    found = []
    for job, folder in zip(jobs, runs, strict=True):
        figure = "pixel_r1" if job.model == "cn3d" else "psnr"
        history = read_json(Path(folder) / HISTORY_FILE).items()
        curve = [[one.integer("iteration"), one.number(figure)] for one in history if one.has(figure)]
        found.append({"model": job.model, "seed": job.seed, "figure": figure, "curve": curve})
    return found
