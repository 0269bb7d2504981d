"""The never-ending loop: look around with the detector there is, label, learn, and look around again with the new one.

Every round of rooms is in homes that the robot has not been in: the more homes it has seen, the more it knows of those
it has not. A few episodes begin in different places of each, and what one has found is labelled in the others, too.
Towns are large, and few: there the robot comes back in later rounds, and old views teach more as it gets to know its
places. The detector of the round before finds the objects to go to and to circle; labels are made of what the
pre-trained one finds in the views. It has learnt from no label that was wrong, so that what a round gets wrong does not
come back as a label of the next. A round goes on with the network of the round before, and learns from the views of all
rounds so far, with source photographs mixed in, so that nothing is forgotten. No round knows ground truth: it is for
the figures alone. The loop stops itself when labels collapse, which it tells from the labels, too.
"""

import statistics
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from experiments.cache.stages import Scale, Workplace, digest
from experiments.cache.worlds import DETECTOR, WORLDS
from experiments.tables import fine_tuning
from experiments.tables.training_sets import Lessons, Part
from labeling.generator.settings.source_config import SourceConfig

if TYPE_CHECKING:
    from experiments.cache.detector_stages import Course
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

Split = Literal["train", "endless"]
POLICY = "ppo"
"""Who moves: the trained policy that comes with the project."""
TRIED_ON: Part = "wide"
"""Gains of a round are small: many unseen scenes tell them from chance."""
PARTS = ("learn", "choose")
"""What the episodes of a round are there for: to learn from, and to choose the best network by."""
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


SIZES: dict[Scale, Size] = {
    "smoke": Size(2, {"rooms": (1, 1), "streets": (1, 1)}),
    "quick": Size(10, {"rooms": (12, 2), "streets": (8, 1)}),
    "full": Size(10, {"rooms": (40, 8), "streets": (30, 5)}),
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
    split: Split
    """Where its episodes are: in the few named scenes, or in others every time."""
    episodes_per_scene: int
    """Begun in different places of a scene before the next."""

    def run(self, workplace: Workplace) -> dict[str, Any]:
        """Goes through the rounds, of all seeds side by side; what was done before is not done again.

        Returns:
            By seed: every round's figures, and why the loop stopped, if it did.
        """
        import sys

        from tqdm import tqdm

        from experiments.cache.detector_stages import taught

        size, lessons = SIZES[workplace.scale], Lessons(self.world, workplace)
        runs = [_Run(seed, size, self, lessons, workplace) for seed in workplace.seeds]
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
            "size": {"rounds": size.rounds, "learn": learn, "choose": choose},
            "settings": lessons.settings(),
            "split": self.split,
            "episodes_per_scene": self.episodes_per_scene,
            "collapse": {"fewer": FEWER, "less_sure": LESS_SURE, "one_sided": ONE_SIDED},
            "test": lessons.about(TRIED_ON),
            "before": lessons.detector_figures(TRIED_ON, [DETECTOR])[0],
            "loops": [{"seed": one.seed, "rounds": one.rounds, "stopped": one.stopped} for one in runs],
        }

    def report(self, results: Path, docs: Path) -> list[Path]:
        """Writes the page of all results, and its pictures.

        Returns:
            The files written.
        """
        from experiments.pages.results import write_page

        return write_page(results, docs)


class _Run:
    """The rounds of one seed."""

    def __init__(self, seed: int, size: Size, loop: Loop, lessons: Lessons, workplace: Workplace) -> None:
        """Begins with the pre-trained detector."""
        self.seed = seed
        self.rounds: list[dict[str, Any]] = []
        """Figures so far."""
        self.stopped: str | None = None
        """Why the loop stopped, if it did."""
        self._size, self._loop, self._lessons, self._workplace = size, loop, lessons, workplace
        self._detector = DETECTOR
        self._episodes: dict[str, Path] = {}
        self._signs: list[Signs] = []

    def collect(self, number: int) -> "Course | None":
        """Collects and labels; returns what is to be learnt, None if the loop has stopped."""
        from experiments.cache.detector_stages import label, label_scores
        from experiments.cache.episode_pool import gather

        if self.stopped is not None:
            return None
        new = self._record(number)
        self._episodes.update(new)
        first = next(iter(self._episodes.values())).parent.name
        dataset = gather(f"{self._lessons.world}_loop-{self.seed}-{digest(first)}", self._episodes, self._workplace)
        teacher = SourceConfig(detector=DETECTOR)
        labels = label(dataset, self.seed, self._workplace, sources=teacher, share_scenes=True, growing=True)
        pictures = pictures_by_episode(labels)
        self._signs.append(signs_of(_of_part(pictures, new, "learn")))
        self.rounds.append({"round": number, "labels": label_scores(labels), "signs": asdict(self._signs[-1])})
        self.stopped = collapse(self._signs)
        if self.stopped is not None:
            return None
        return self._course(*(_of_part(pictures, self._episodes, part) for part in PARTS))

    def redeploy(self, detector: str, figures: dict[str, Any]) -> None:
        """Goes on with another detector, whose figures are these."""
        self._detector = detector
        self.rounds[-1]["test"] = figures

    def _record(self, number: int) -> dict[str, Path]:
        """The episodes of a round, by names that tell them from those of all others."""
        from experiments.cache.episode_pool import Pool, record

        world, found = self._lessons.world, {}
        for place, (part, count) in enumerate(zip(PARTS, self._size.episodes[world], strict=True)):
            pool_seed = FIRST_POOL_SEED + 1000 * self.seed + 2 * number + place
            pool = Pool(
                f"{world}_round_{part}",
                WORLDS[world],
                self._loop.split,
                count,
                pool_seed,
                self._detector,
                POLICY,
                self._loop.episodes_per_scene,
            )
            for folder in record(pool, self._workplace):
                found[f"{number:02d}-{part}-{digest(folder.parent.name)[:8]}-{folder.name}"] = folder
        return found

    def _course(self, learn: "Sequence[AnnotatedPicture]", choose: "Sequence[AnnotatedPicture]") -> "Course":
        from experiments.cache.detector_stages import Course

        size = fine_tuning.SIZES[self._workplace.scale]
        return Course(
            self._detector,
            learn,
            choose,
            self._lessons.photographs()[0],
            size.train,
            size.augment[self._lessons.world],
            self.seed,
            f"the labels of {len(self.rounds)} rounds",
        )


def pictures_by_episode(labels: Path) -> "dict[str, list[AnnotatedPicture]]":
    """Labelled pictures of a label set, by the names of their episodes."""
    from labeling.detectors.data.annotated_pictures import read_pictures
    from labeling.io.label_set import read_label_set

    dataset = read_label_set(labels).dataset
    if dataset is None:
        raise ValueError(f"{labels} does not say which dataset it was made from")
    found: dict[str, list[AnnotatedPicture]] = defaultdict(list)
    for picture in read_pictures(labels):
        found[picture.file.relative_to(dataset).parts[0]].append(picture)
    return dict(found)


def _of_part(
    pictures: "Mapping[str, Sequence[AnnotatedPicture]]", episodes: Iterable[str], part: str
) -> "list[AnnotatedPicture]":
    """Of the episodes that are there to learn from, or to choose the best network by."""
    return [one for name in episodes if f"-{part}-" in name for one in pictures[name]]


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
rooms = Loop(f"rooms: {_WHAT}", "rooms", "endless", 3)
streets = Loop(f"streets: {_WHAT}", "streets", "train", 1)
