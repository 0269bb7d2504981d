"""What errors of labels cost a detector that learns from them: its own labels, with one kind of error after the other
mended by ground truth, up to ground truth itself. And what it costs to replay photographs meanwhile.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES
from experiments.tables.label_errors import count_errors, file_in_dataset, objects_of, of_ignored
from experiments.tables.thesis_tables import TABLES
from experiments.tables.training_sets import TRUTH, TrainingSets
from labeling.detectors.finetuning.config import FinetuneConfig

if TYPE_CHECKING:
    from experiments.cache.detector_stages import TrainJob
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

LABELS, WITHOUT_FALSE, TRUE_MASKS = "shared", "without false labels", "with true masks"
TEACHERS = (LABELS, WITHOUT_FALSE, TRUE_MASKS, TRUTH)
"""What a detector learns from, from the labels of the generator to what the simulator knows. Each mends one kind of
error of the one before it; the last lacks no object, believes all and ignores what nobody could tell."""
ALONE = {LABELS: "shared, no photographs", TRUTH: "truth, no photographs"}
"""Of these two, what the record calls learning from them alone: whole batches of them, where photographs otherwise
have half of each."""
INTERPOLATED = {LABELS: "shared, no photographs, interpolated", TRUTH: "truth, no photographs, interpolated"}
"""The same, where the network that is kept lies between the one before and the one that is learnt, as by default in
``labeling.finetune``."""

SCENES_OF = {"rooms": "table_5_3", "streets": "table_5_1"}
"""By world, the table whose scenes are learnt in, so that trainings are shared."""


@experiment(
    "fine_tuning",
    "what false labels and wrong masks cost compact, which learns from them in rooms; tested on dev homes",
    pages=("fine_tuning",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores in rooms; see ``cost_of_errors``."""
    return cost_of_errors("rooms", context)


@experiment("fine_tuning_streets", "the same in streets; tested on dev towns", pages=("fine_tuning",))
def run_streets(context: RunContext) -> dict[str, Any]:
    """The same in streets."""
    return cost_of_errors("streets", context)


def cost_of_errors(world: str, context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores.

    Args:
        world: one of ``experiments.cache.worlds.WORLDS``.
        context: scale, seeds and cache.

    Returns:
        The episodes, how many labels are false and how many objects have none, the detector before, and every run by
        teacher and seed.
    """
    sets = TrainingSets(world, context, endless=TABLES[SCENES_OF[world]].endless)
    jobs = {(teacher, seed): mended_job(sets, teacher, seed) for teacher in TEACHERS for seed in context.seeds}
    for names, share in ((ALONE, 1.0), (INTERPOLATED, FinetuneConfig.interpolate)):
        for teacher, name in names.items():
            for seed in context.seeds:
                job = jobs[teacher, seed]
                jobs[name, seed] = replace(job, replay=(), train=replace(job.train, interpolate=share))
    runs = [({"teacher": teacher, "seed": seed}, job) for (teacher, seed), job in jobs.items()]
    return {
        "world": world,
        "detector": DETECTOR,
        "settings": SIZES[context.scale].settings(world),
        "pools": {subset: sets.pool_record(subset) for subset in ("learn", "dev")},
        "labels": [
            {"seed": seed, **count_errors(sets.training_pictures("learn", LABELS, seed), sets.pictures("learn"))}
            for seed in context.seeds
        ],
        **sets.train_and_score(runs, "dev"),
    }


def mended_job(sets: TrainingSets, teacher: str, seed: int) -> "TrainJob":
    """The fine-tuning on one of ``TEACHERS``."""
    if teacher in (LABELS, TRUTH):
        return sets.train_job(teacher, seed)
    job = sets.train_job(LABELS, seed)
    learn = mended(job.learn, sets.pictures("learn"), teacher == TRUE_MASKS)
    return replace(job, learn=learn, title=f"labels {teacher} in {sets.world}")


def mended(
    labels: "Sequence[AnnotatedPicture]", truths: "Sequence[AnnotatedPicture]", true_masks: bool
) -> "list[AnnotatedPicture]":
    """Labels without those that stand for no object; those of objects that are to be ignored become regions to ignore.

    Args:
        labels: pictures with labels. Regions to ignore stay as they are.
        truths: the same pictures, in any order, with ground truth.
        true_masks: give labels the masks of the objects that they stand for. Their weights stay.
    """
    known, found = {file_in_dataset(picture): picture for picture in truths}, []
    for picture in labels:
        pairs = objects_of(picture, known[file_in_dataset(picture)])
        kept = [one for one in picture.annotations if one.ignore]
        kept += [replace(one, ignore=True) for one in of_ignored(picture, known[file_in_dataset(picture)], pairs)]
        for label, truth in pairs:
            kept.append(replace(label, rle=truth.rle) if true_masks else label)
        found.append(replace(picture, annotations=tuple(kept)))
    return found
