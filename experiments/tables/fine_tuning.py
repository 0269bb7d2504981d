"""``compact`` before and after it learned from labels that an agent made itself, beside ground truth as the ceiling."""

from collections.abc import Sequence
from typing import Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES
from experiments.tables.training_sets import TRUTH, Subset, TrainingSets

TEACHERS = {"labels": "sbm", "truth": TRUTH}
"""What a run learns from, the label generator's output or what the simulator knows, as training sets name it."""
SUBSETS: tuple[Subset, ...] = ("learn", "choose", "val")


@experiment(
    "fine_tuning",
    "compact fine-tuned on pseudo-labels and on ground truth of training scenes, tested on validation scenes",
    pages=("fine_tuning",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores.

    Returns:
        For each world: the episodes, how good the labels are, the detector before, and every run by teacher and seed.
    """
    size = SIZES[context.scale]
    return {
        "detector": DETECTOR,
        "settings": size.settings(*size.episodes),
        "worlds": {world: _one_world(TrainingSets(world, context), context.seeds) for world in size.episodes},
    }


def _one_world(sets: TrainingSets, seeds: Sequence[int]) -> dict[str, Any]:
    from experiments.cache.detector_stages import score_labels

    runs = [
        ({"teacher": name, "seed": seed}, sets.train_job(teacher, seed))
        for seed in seeds
        for name, teacher in TEACHERS.items()
    ]
    return {
        "pools": {subset: sets.pool_record(subset) for subset in SUBSETS},
        "labels": [{"seed": seed, **score_labels(sets.labels("learn", "sbm", seed))} for seed in seeds],
        **sets.train_and_score(runs),
    }
