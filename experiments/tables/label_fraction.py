"""Boxes on a memory by the share of scenes that are labelled: from random weights, or after learning without labels.

After Harley et al. 2020, table 2. The memories are those of ``view_prediction``, which have seen all of the rooms that
are learnt from, without a label.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.cache.memory_box_stages import BoxJob, SceneScores, score_scenes, train_box_nets
from experiments.cache.memory_stages import train_memories
from experiments.cache.object_rooms import ObjectRooms, record_boxed_rooms
from experiments.cache.origin import MACHINE, machine_of, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.tables import view_prediction
from experiments.tables.view_prediction import CN3D, GRNN, MODELS, TRAINED_ON
from labeling.memory.settings.box_settings import TrainBoxesConfig

SCRATCH, PRETRAINED = "from random weights", {GRNN: "after view prediction", CN3D: "after contrast"}
FRACTIONS = (0.01, 0.05, 0.1, 0.25, 1.0)


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has beside what ``view_prediction`` says."""

    test: int
    """Rooms to report on."""
    train: TrainBoxesConfig
    """For all fractions the same number of batches; the last network is kept, as choosing would take labels, too."""
    inputs: tuple[int, ...] = (4,)
    fractions: tuple[float, ...] = FRACTIONS


SIZES: dict[Scale, Size] = {
    "smoke": Size(2, TrainBoxesConfig(iterations=4, validate_every=4, views=2), (2,), (0.3, 1.0)),
    "quick": Size(96, TrainBoxesConfig(iterations=300, validate_every=300, views=2), (2,)),
    "standard": Size(96, TrainBoxesConfig(iterations=1500, validate_every=1500, views=4), (1, 4)),
    "full": Size(96, TrainBoxesConfig(iterations=10_000, validate_every=10_000, views=8, batch_size=4), (1, 4, 8)),
}


@experiment(
    "label_fraction",
    "3-D boxes on a memory with 1 to 100 % of labels: from random weights, after view prediction, after contrast",
    pages=("memory.boxes",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, trains what has not been trained, and scores.

    Returns:
        Settings, and by network, beginning, share of labels and seed the figures by the number of views given.
    """
    size, of_memories = SIZES[context.scale], view_prediction.SIZES[context.scale]
    learn = record_boxed_rooms(ObjectRooms(TRAINED_ON, of_memories.learn), context)
    test = tuple(record_boxed_rooms(ObjectRooms(TRAINED_ON, size.test, seed=2), context))
    named = view_prediction.memory_jobs(context, tuple(PRETRAINED))
    memories = train_memories([job for _, job in named], context)
    rows, jobs = [], []
    for (name, memory), begun in zip(named, memories, strict=True):
        for beginning, weights in ((SCRATCH, None), (PRETRAINED[name], begun)):
            for share in size.fractions:
                labelled = drawn_rooms(learn, share, memory.seed)
                row = {"name": name, "beginning": beginning, "share": share, "seed": memory.seed}
                rows.append({**row, "labelled": len(labelled)})
                title = f"{name} {beginning}, {100 * share:g} %"
                jobs.append(
                    BoxJob(MODELS[name], labelled, (), of_memories.memory, size.train, memory.seed, title, weights)
                )
    runs = train_box_nets(jobs, context)
    categories = known_categories(test)
    around = size.train.around
    wanted = [SceneScores("memory", one, test, of_memories.memory, around, size.inputs, categories) for one in runs]
    scores = score_scenes(wanted, context)
    return {
        "settings": {
            "memory": asdict(of_memories.memory),
            "train": asdict(size.train),
            "scenes": {"learn": len(learn), "test": len(test)},
            "inputs": list(size.inputs),
            "shares": list(size.fractions),
        },
        "categories": list(categories),
        "machines": machines([*memories, *runs]),
        "rows": [
            {**row, MACHINE: machine_of(one), **found} for row, one, found in zip(rows, runs, scores, strict=True)
        ],
    }


def drawn_rooms(rooms: Sequence[Path], share: float, seed: int) -> tuple[Path, ...]:
    """Which rooms are labelled, in their order: other ones for every seed, and with a larger share more beside them."""
    order = np.random.default_rng([seed, 1]).permutation(len(rooms))
    return tuple(rooms[number] for number in sorted(order[: labelled_scenes(share, len(rooms))]))


def labelled_scenes(share: float, scenes: int) -> int:
    """How many scenes are labelled, at least one.

    >>> [labelled_scenes(share, 150) for share in FRACTIONS]
    [2, 8, 15, 38, 150]
    """
    return max(1, math.ceil(share * scenes - 1e-9))


def known_categories(episodes: Any) -> tuple[str, ...]:
    """All categories of objects that stand in some episodes."""
    from labeling.io.episodes import read_episode

    return tuple(sorted({one.category for folder in episodes for one in read_episode(folder).ground_truth or ()}))
