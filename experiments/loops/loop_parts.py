"""What of the never-ending loop's gain comes from where: from new homes, and from going round."""

from typing import Any

from experiments.cache.origin import MACHINES, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.loops.never_ending import LOOPS, TEST_SUBSET
from experiments.loops.rounds import LABELS, SCORES, TRUTH
from experiments.tables.training_sets import TrainingSets

LOOP = "never_ending"
BEFORE, THE_LOOP = "pre-trained", "round by round"
AT_ONCE, FIRST_HOMES = "labels of all rounds at once", "labels of the first round alone"
"""The loop as it is; the pre-trained network taught by all its labels in one training; and by those of the first round
alone. All in as many batches."""
TRUE_LOOP, TRUE_AT_ONCE = "ground truth, round by round", "ground truth of all rounds at once"
"""The ceilings of the first two."""


@experiment(
    f"{LOOP}_parts",
    "rooms: what the loop gains by going round, and by ever new homes",
    pages=("results",),
    has_rounds=True,
)
def run(context: RunContext) -> dict[str, Any]:
    """Goes round, and trains the others.

    Returns:
        The episodes to test on, and by row the figures of each seed whose loop did not stop.
    """
    from experiments.cache.detector_stages import train_detectors

    loop = LOOPS[LOOP]
    about, loops = loop.record(context), [one for one in loop.go_round(context) if one.stopped is None]
    jobs = {AT_ONCE: [one.anew(None, AT_ONCE) for one in loops]}
    jobs |= {FIRST_HOMES: [one.anew(one.episodes_of(1), FIRST_HOMES) for one in loops]}
    jobs |= {TRUE_AT_ONCE: [one.anew(None, TRUE_AT_ONCE, TRUTH) for one in loops]}
    names = train_detectors([job for some in jobs.values() for job in some], context)
    scores = iter(TrainingSets(loop.places.world, context).detector_scores(TEST_SUBSET, names))
    rows = {BEFORE: [about["before"] for _ in loops], THE_LOOP: [one.records[-1][SCORES[LABELS]] for one in loops]}
    rows |= {name: [next(scores) for _ in some] for name, some in jobs.items()}
    rows |= {TRUE_LOOP: [one.records[-1][SCORES[TRUTH]] for one in loops]}
    return {
        "world": about["world"],
        "gaps": [[BEFORE, THE_LOOP, TRUE_LOOP], [BEFORE, AT_ONCE, TRUE_AT_ONCE]],
        "pools": {TEST_SUBSET: about["test"]},
        "size": about["size"],
        "settings": about["settings"],
        MACHINES: machines([*names, *(name for one in loops for name in one.trained)]),
        "rows": [
            {
                "name": name,
                "part": TEST_SUBSET,
                "labels": None,
                "teacher": None if name == BEFORE else name,
                "runs": [{"seed": one.seed, **found} for one, found in zip(loops, some, strict=True)],
            }
            for name, some in rows.items()
        ],
    }
