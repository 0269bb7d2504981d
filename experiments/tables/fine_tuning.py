"""``compact`` before and after it learned from labels that an agent made itself, beside ground truth as the ceiling."""

from typing import TYPE_CHECKING, Any

from experiments.cache import worlds
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES, WORLDS

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

TEACHERS = ("labels", "truth")
"""What a run learns from: the label generator's output, or what the simulator knows."""


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
    photographs = worlds.source_photographs(size.photographs, context)
    return {
        "detector": DETECTOR,
        "settings": size.settings(*size.episodes),
        "worlds": {world: _one_world(world, photographs, context) for world in size.episodes},
    }


def _one_world(
    world: str, photographs: "tuple[list[AnnotatedPicture], list[AnnotatedPicture]]", context: RunContext
) -> dict[str, Any]:
    from experiments.cache.detector_stages import TrainJob, make_labels, score_labels, train_and_score
    from experiments.cache.episode_pool import EpisodePool, pool_record, record
    from labeling.detectors.data.annotated_pictures import read_pictures

    size, (replay, held_out) = SIZES[context.scale], photographs
    learn, choose, val = size.episodes[world]
    pools = {
        "learn": EpisodePool(f"{world}_learn", WORLDS[world], "train", learn, 0, DETECTOR),
        "choose": EpisodePool(f"{world}_choose", WORLDS[world], "train", choose, 1, DETECTOR),
        "val": EpisodePool(f"{world}_val", WORLDS[world], "val", val, 0, DETECTOR),
    }
    folders = {name: record(pool, context) for name, pool in pools.items()}
    runs, labels = [], []
    for seed in context.seeds:
        made = {name: make_labels(folders[name], seed, context) for name in ("learn", "choose")}
        labels.append({"seed": seed, **score_labels(made["learn"])})
        for teacher in TEACHERS:
            sources = made if teacher == "labels" else {name: folders[name][0].parent for name in made}
            pictures = {name: read_pictures(source) for name, source in sources.items()}
            title, how = f"{teacher} of {world}", (size.train, size.augment[world])
            job = TrainJob(DETECTOR, pictures["learn"], pictures["choose"], replay, *how, seed, title)
            runs.append(({"teacher": teacher, "seed": seed}, job))
    sets = {"validation": read_pictures(folders["val"][0].parent), "photographs": held_out}
    return {
        "pools": {name: pool_record(pool, folders[name]) for name, pool in pools.items()},
        "labels": labels,
        **train_and_score(runs, DETECTOR, sets, context),
    }
