"""What a detector learns, by how it is fine-tuned: from labels that an agent made itself, and from ground truth."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.cache.worlds import DETECTOR, SIZES
from experiments.tables.training_sets import TRUTH, Subset, TrainingSets
from labeling.detectors.finetuning.config import FinetuneConfig

TEACHERS = {"labels": "shared", "truth": TRUTH}
"""What a run learns from, the label generator's output or what the simulator knows, as training sets name it."""
SUBSETS: tuple[Subset, ...] = ("learn", "choose", "dev")


@dataclass(frozen=True)
class Variant:
    """A way of fine-tuning."""

    name: str
    train: dict[str, Any] = field(default_factory=dict)
    """Settings that differ from those of the tables."""

    def config(self, tables: FinetuneConfig) -> FinetuneConfig:
        """Its settings."""
        return replace(tables, **self.train)


TABLES = "as in the tables"
VARIANTS = (
    Variant(TABLES),
    Variant("rare categories repeated", {"repeat_threshold": 0.3}),
    Variant("all of the trunk learns", {"frozen_stages": 0}),
    Variant("three times as long", {"iterations": 720}),
)
TRIED: dict[Scale, tuple[Variant, ...]] = {"smoke": VARIANTS[:2], "quick": VARIANTS[:2], "full": VARIANTS}


@experiment(
    "fine_tuning",
    "compact fine-tuned in several ways on shared labels and on ground truth, tested on dev scenes, which decide",
    pages=("fine_tuning",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores.

    Returns:
        For each world: the episodes, how good the labels are, the detector before, and every run by variant, teacher
        and seed.
    """
    size, variants = SIZES[context.scale], TRIED[context.scale]
    return {
        "detector": DETECTOR,
        "settings": size.settings(*size.episodes),
        "variants": {variant.name: variant.train for variant in variants},
        "worlds": {world: _one_world(TrainingSets(world, context), context.seeds, variants, size.train)
                   for world in size.episodes},
    }  # fmt: skip


def _one_world(
    sets: TrainingSets, seeds: Sequence[int], variants: Sequence[Variant], tables: FinetuneConfig
) -> dict[str, Any]:
    from experiments.cache.detector_stages import score_labels

    runs = [
        (
            {"variant": variant.name, "teacher": name, "seed": seed},
            replace(sets.train_job(teacher, seed), train=variant.config(tables)),
        )
        for variant in variants
        for name, teacher in TEACHERS.items()
        for seed in seeds
    ]
    return {
        "pools": {subset: sets.pool_record(subset) for subset in SUBSETS},
        "labels": [{"seed": seed, **score_labels(sets.labels("learn", "shared", seed))} for seed in seeds],
        **sets.train_and_score(runs, "dev"),
    }
