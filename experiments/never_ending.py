"""The never-ending loop: look around with the detector there is, label, learn, and look around again with the new one.

Every round's episodes begin elsewhere. A round learns from its own labels and from those of all rounds before, with
source photographs mixed in, so that nothing is forgotten. No round knows ground truth: it is for the figures alone.
The loop stops itself when labels collapse, which it tells from the labels, too.
"""

import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments import fine_tuning
from experiments.lessons import Lessons, Part
from experiments.stages import Scale, Workplace

if TYPE_CHECKING:
    from experiments.detector_stages import Course
    from labeling.detectors.pictures import AnnotatedPicture

POLICY = "ppo"
"""Who moves: the trained policy that comes with the project."""
TRIED_ON: Part = "wide"
"""Gains of a round are small: many unseen scenes tell them from chance."""
FIRST_POOL_SEED = 1000
"""Seeds of the episodes of rounds count up from here, apart from those of all other experiments."""
FEWER = 0.5
"""Labels per view that fall below this share of what earlier rounds had at best are a collapse."""
LESS_SURE = 0.15
"""So is a mean confidence of labels that falls by this below the best of earlier rounds."""
ONE_SIDED = 0.8
"""So is a category that has at least this share of all labels, and had not in the first round."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    rounds: int
    episodes: dict[str, tuple[int, int]]
    """By world: episodes of a round to learn from, and to choose the best network by."""
    iterations: int
    """Batches of training in a round."""


SIZES: dict[Scale, Size] = {
    "smoke": Size(2, {"rooms": (1, 1), "streets": (1, 1)}, 2),
    "quick": Size(5, {"rooms": (12, 2), "streets": (8, 1)}, 100),
    "full": Size(10, {"rooms": (40, 8), "streets": (30, 5)}, 1000),
}


@dataclass(frozen=True)
class Signs:
    """What a robot itself can tell about its labels."""

    labels_per_view: float
    confidence: float
    """Mean over labels."""
    shares: dict[str, float]
    """Of each category among the labels."""


@dataclass(frozen=True)
class Loop:
    """An experiment: rounds in one world."""

    DESCRIPTION: str
    world: str

    def run(self, workplace: Workplace) -> dict[str, Any]:
        """Goes through the rounds, of all seeds side by side; what was done before is not done again.

        Returns:
            By seed: every round's figures, and why the loop stopped, if it did.
        """
        import sys

        from tqdm import tqdm

        from experiments.detector_stages import taught

        size, lessons = SIZES[workplace.scale], Lessons(self.world, workplace)
        runs = [_Run(seed, size, lessons, workplace) for seed in workplace.seeds]
        for number in tqdm(range(1, size.rounds + 1), desc="rounds", unit="round", file=sys.stderr):
            courses = {one: course for one in runs for course in [one.collect(number)] if course is not None}
            detectors = taught(list(courses.values()), workplace)
            figures = lessons.detector_figures(TRIED_ON, detectors)
            for one, detector, found in zip(courses, detectors, figures, strict=True):
                one.redeploy(detector, found)
        learn, choose = size.episodes[self.world]
        return {
            "world": self.world,
            "policy": POLICY,
            "size": {"rounds": size.rounds, "learn": learn, "choose": choose, "iterations": size.iterations},
            "settings": lessons.settings(),
            "collapse": {"fewer": FEWER, "less_sure": LESS_SURE, "one_sided": ONE_SIDED},
            "test": lessons.about(TRIED_ON),
            "before": lessons.detector_figures(TRIED_ON, [fine_tuning.DETECTOR])[0],
            "loops": [{"seed": one.seed, "rounds": one.rounds, "stopped": one.stopped} for one in runs],
        }

    def report(self, results: Path, docs: Path) -> list[Path]:
        """Writes the page of all results, and its pictures.

        Returns:
            The files written.
        """
        from experiments.results_page import write_page

        return write_page(results, docs)


class _Run:
    """The rounds of one seed."""

    def __init__(self, seed: int, size: Size, lessons: Lessons, workplace: Workplace) -> None:
        """Begins with the pre-trained detector."""
        self.seed = seed
        self.rounds: list[dict[str, Any]] = []
        """Figures so far."""
        self.stopped: str | None = None
        """Why the loop stopped, if it did."""
        self._size, self._lessons, self._workplace = size, lessons, workplace
        self._detector = fine_tuning.DETECTOR
        self._learnt: list[AnnotatedPicture] = []
        self._chosen_by: list[AnnotatedPicture] = []
        self._signs: list[Signs] = []

    def collect(self, number: int) -> "Course | None":
        """Collects and labels; returns what is to be learnt, None if the loop has stopped."""
        if self.stopped is not None:
            return None
        found = _Round(number, self.seed, self._detector, self._size, self._lessons.world, self._workplace)
        self._signs.append(found.signs())
        self.rounds.append({"round": number, "labels": found.figures(), "signs": asdict(self._signs[-1])})
        self.stopped = collapse(self._signs)
        if self.stopped is not None:
            return None
        self._learnt += found.lesson("learn")
        self._chosen_by += found.lesson("choose")
        return found.course(self._learnt, self._chosen_by, self._lessons)

    def redeploy(self, detector: str, figures: dict[str, Any]) -> None:
        """Goes on with another detector, whose figures are these."""
        self._detector = detector
        self.rounds[-1]["test"] = figures


class _Round:
    """One round."""

    def __init__(self, number: int, seed: int, detector: str, size: Size, world: str, workplace: Workplace) -> None:
        """Collects and labels."""
        from experiments.detector_stages import label
        from experiments.episode_pool import Pool, record

        self._number, self._seed, self._detector = number, seed, detector
        self._size, self._world, self._workplace = size, world, workplace
        self._labels: dict[str, Path] = {}
        for place, (part, count) in enumerate(zip(("learn", "choose"), size.episodes[world], strict=True)):
            pool_seed = FIRST_POOL_SEED + 1000 * seed + 2 * number + place
            env = fine_tuning.WORLDS[world]
            pool = Pool(f"{world}_round_{part}", env, "train", count, pool_seed, detector, POLICY)
            self._labels[part] = label(record(pool, workplace), seed, workplace)

    def figures(self) -> dict[str, Any]:
        """How good the labels are, and the detector they are made with, on the same views."""
        from experiments.detector_stages import label_scores

        return label_scores(self._labels["learn"])

    def signs(self) -> Signs:
        """What can be told without ground truth."""
        return signs_of(self.lesson("learn"))

    def lesson(self, part: str) -> "list[AnnotatedPicture]":
        """The labels."""
        from labeling.detectors.pictures import read_pictures

        return read_pictures(self._labels[part])

    def course(
        self, learnt: "Sequence[AnnotatedPicture]", chosen_by: "Sequence[AnnotatedPicture]", lessons: Lessons
    ) -> "Course":
        """What the detector is to learn from this round and those before."""
        from experiments.detector_stages import Course

        size = fine_tuning.SIZES[self._workplace.scale]
        return Course(
            self._detector,
            list(learnt),
            list(chosen_by),
            lessons.photographs()[0],
            replace(size.train, iterations=self._size.iterations),
            size.augment[self._world],
            self._seed,
            f"the labels of {self._number} rounds",
        )


def signs_of(pictures: "Sequence[AnnotatedPicture]") -> Signs:
    """What labelled pictures say about themselves.

    Args:
        pictures: at least one.
    """
    labels = [one for picture in pictures for one in picture.annotations if not one.ignore]
    counts = Counter(one.category for one in labels)
    return Signs(
        labels_per_view=len(labels) / len(pictures),
        confidence=statistics.fmean(one.weight for one in labels) if labels else 0.0,
        shares={name: count / len(labels) for name, count in sorted(counts.items())},
    )


def collapse(signs: Sequence[Signs]) -> str | None:
    """Whether the labels of the latest round have collapsed, and how.

    Args:
        signs: of all rounds so far, at least one.

    Returns:
        A sentence, None if they have not.
    """
    *before, now = signs
    if now.labels_per_view == 0.0:
        return "there are no labels"
    if not before:
        return None
    most, surest = max(one.labels_per_view for one in before), max(one.confidence for one in before)
    if now.labels_per_view < FEWER * most:
        return f"labels per view fell from {most:.2f} to {now.labels_per_view:.2f}"
    if now.confidence < surest - LESS_SURE:
        return f"the mean confidence of labels fell from {surest:.2f} to {now.confidence:.2f}"
    name = max(now.shares, key=lambda one: now.shares[one])
    if now.shares[name] >= ONE_SIDED > before[0].shares.get(name, 0.0):
        return f"{now.shares[name]:.0%} of all labels are {name}"
    return None


_WHAT = "rounds of collecting, labelling, fine-tuning and redeploying; what labels, detector and photographs show"
rooms = Loop(f"rooms: {_WHAT}", "rooms")
streets = Loop(f"streets: {_WHAT}", "streets")
