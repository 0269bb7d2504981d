"""The never-ending loop: look around with the detector there is, label, fine-tune, and look around again with it.

A few episodes begin in different places of each home or town, and what one has found is labelled in the others, too.
The detector of the round before finds the objects to go to and to circle; labels are made of what the pre-trained one
finds in the views: it has learnt from no label that was wrong, so that what a round gets wrong does not come back as a
label of the next. A round goes on with the network of the round before, and learns from the views of all rounds so far,
with source photographs mixed in, so that nothing is forgotten. No round knows ground truth: it is for the figures, and
for the ceiling, a network that is taught by ground truth of the same views, round by round, in the same batches. The
loop stops itself when labels collapse, which it tells from the labels, too.
"""

from dataclasses import dataclass
from typing import Any

from experiments.cache.origin import MACHINES, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR
from experiments.loops import signs
from experiments.loops.rounds import POLICY, SIZES, Places, SeedRounds, num_rounds
from experiments.tables.training_sets import Subset, TrainingSets

TEST_SUBSET: Subset = "wide"
"""Gains of a round are small: many unseen scenes tell them from chance."""


@dataclass(frozen=True)
class SelfTrainingLoop:
    """Rounds of collecting, labelling and fine-tuning in one world."""

    places: Places

    def run(self, context: RunContext) -> dict[str, Any]:
        """Goes round, and records it.

        Returns:
            By seed: every round's figures, and why the loop stopped, if it did.
        """
        loops = self.go_round(context)
        return {
            **self.record(context),
            MACHINES: machines(name for one in loops for name in one.trained),
            "loops": [{"seed": one.seed, "rounds": one.records, "stopped": one.stopped} for one in loops],
        }

    def go_round(self, context: RunContext) -> list[SeedRounds]:
        """Goes through the rounds, of all seeds in parallel; what was done before is not done again."""
        import sys

        from tqdm import tqdm

        from experiments.cache.detector_stages import train_detectors

        sets = TrainingSets(self.places.world, context)
        loops = [SeedRounds(seed, self.places, sets, context) for seed in context.seeds]
        numbers = range(1, num_rounds(context) + 1)
        for number in tqdm(numbers, desc="rounds", unit="round", file=sys.stderr):
            jobs = [(one, *job) for one in loops for job in one.collect(number).items()]
            detectors = train_detectors([job for _, _, job in jobs], context)
            scores = sets.detector_scores(TEST_SUBSET, detectors)
            for (one, teacher, _), detector, found in zip(jobs, detectors, scores, strict=True):
                one.deploy(teacher, detector, found)
        return loops

    def record(self, context: RunContext) -> dict[str, Any]:
        """What the record of results says about all seeds alike."""
        sets = TrainingSets(self.places.world, context)
        return {
            "world": self.places.world,
            "policy": POLICY,
            "size": {"rounds": num_rounds(context), "learn": SIZES[context.scale].episodes[self.places.world]},
            "settings": sets.settings(),
            "split": self.places.split,
            "episodes_per_scene": self.places.episodes_per_scene,
            "collapse": {
                "rounds": signs.TREND_ROUNDS,
                "fewer": signs.MIN_LABEL_RATIO,
                "less_sure": signs.MAX_CONFIDENCE_DROP,
                "one_sided": signs.MAX_CATEGORY_SHARE,
            },
            "test": sets.pool_record(TEST_SUBSET),
            "before": sets.detector_scores(TEST_SUBSET, [DETECTOR])[0],
        }


LOOPS = {
    "never_ending": SelfTrainingLoop(Places("rooms", "endless", 3)),
    "never_ending_again": SelfTrainingLoop(Places("rooms", "train", 1)),
    "never_ending_streets": SelfTrainingLoop(Places("streets", "endless", 4)),
}
for _name, _loop in LOOPS.items():
    _where = "the same few homes again and again" if _loop.places.split == "train" else "new places in every round"
    _what = f"{_loop.places.world}: rounds of recording, labelling, fine-tuning and redeploying in {_where}"
    experiment(_name, _what, pages=("results",), has_rounds=True)(_loop.run)
