"""The never-ending loop: look around with the detector there is, label, fine-tune, and look around again with it.

Every round of rooms is in homes that the robot has not been in: the more homes it has seen, the more it knows of those
it has not. A few episodes begin in different places of each, and what one has found is labelled in the others, too.
Towns are large, and few: there the robot comes back in later rounds, and old views teach more as it gets to know its
places. The detector of the round before finds the objects to go to and to circle; labels are made of what the
pre-trained one finds in the views: it has learnt from no label that was wrong, so that what a round gets wrong does not
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

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale, digest
from experiments.cache.worlds import DETECTOR, WORLDS
from experiments.cache.worlds import SIZES as TRAIN_SIZES
from experiments.tables.training_sets import Subset, TrainingSets
from labeling.generator.settings.source_config import SourceConfig

if TYPE_CHECKING:
    from experiments.cache.detector_stages import TrainJob
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

Split = Literal["train", "endless"]
POLICY = "ppo"
"""Who moves: the trained policy that comes with the project."""
TEST_SUBSET: Subset = "wide"
"""Gains of a round are small: many unseen scenes tell them from chance."""
PURPOSES = ("learn", "choose")
"""What the episodes of a round are there for: to learn from, and to choose the best network by."""
FIRST_POOL_SEED = 1000
"""Seeds of the episodes of rounds count up from here, apart from those of all other experiments."""
MIN_LABEL_RATIO = 0.5
"""Labels per view that fall below this share of the most of earlier rounds are a collapse."""
MAX_CONFIDENCE_DROP = 0.15
"""So is a mean confidence of labels that falls by more than this below the highest of earlier rounds."""
MAX_CATEGORY_SHARE = 0.8
"""So is a category that has at least this share of all labels, and had not in the first round."""


@dataclass(frozen=True)
class LoopSize:
    """How much of everything a scale has."""

    rounds: int
    episodes: dict[str, tuple[int, int]]
    """By world: episodes of a round to learn from, and to choose the best network by."""


SIZES: dict[Scale, LoopSize] = {
    "smoke": LoopSize(2, {"rooms": (1, 1), "streets": (1, 1)}),
    "quick": LoopSize(10, {"rooms": (12, 2), "streets": (8, 1)}),
    "standard": LoopSize(15, {"rooms": (20, 4), "streets": (12, 2)}),
    "full": LoopSize(10, {"rooms": (40, 8), "streets": (30, 5)}),
}


@dataclass(frozen=True)
class LabelStatistics:
    """What a robot itself can tell about its labels."""

    labels_per_view: float
    confidence: float
    """Mean over labels."""
    shares: dict[str, float]
    """Of each category among the labels."""


@dataclass(frozen=True)
class SelfTrainingLoop:
    """Rounds of collecting, labelling and fine-tuning in one world."""

    world: str
    split: Split
    """Where its episodes are: in the few named scenes, or in others every time."""
    episodes_per_scene: int
    """Begun in different places of a scene before the next."""

    def run(self, context: RunContext) -> dict[str, Any]:
        """Goes through the rounds, of all seeds in parallel; what was done before is not done again.

        Returns:
            By seed: every round's figures, and why the loop stopped, if it did.
        """
        import sys

        from tqdm import tqdm

        from experiments.cache.detector_stages import train_detectors

        size, sets = SIZES[context.scale], TrainingSets(self.world, context)
        runs = [_SeedRun(seed, size, self, sets, context) for seed in context.seeds]
        for number in tqdm(range(1, size.rounds + 1), desc="rounds", unit="round", file=sys.stderr):
            jobs = {one: job for one in runs for job in [one.collect(number)] if job is not None}
            detectors = train_detectors(list(jobs.values()), context)
            scores = sets.detector_scores(TEST_SUBSET, detectors)
            for one, detector, found in zip(jobs, detectors, scores, strict=True):
                one.deploy(detector, found)
        learn, choose = size.episodes[self.world]
        return {
            "world": self.world,
            "policy": POLICY,
            "size": {"rounds": size.rounds, "learn": learn, "choose": choose},
            "settings": sets.settings(),
            "split": self.split,
            "episodes_per_scene": self.episodes_per_scene,
            "collapse": {"fewer": MIN_LABEL_RATIO, "less_sure": MAX_CONFIDENCE_DROP, "one_sided": MAX_CATEGORY_SHARE},
            "test": sets.pool_record(TEST_SUBSET),
            "before": sets.detector_scores(TEST_SUBSET, [DETECTOR])[0],
            "loops": [{"seed": one.seed, "rounds": one.rounds, "stopped": one.stopped} for one in runs],
        }


class _SeedRun:
    """The rounds of one seed."""

    def __init__(
        self, seed: int, size: LoopSize, loop: SelfTrainingLoop, sets: TrainingSets, context: RunContext
    ) -> None:
        """Begins with the pre-trained detector."""
        self.seed = seed
        self.rounds: list[dict[str, Any]] = []
        """Figures so far."""
        self.stopped: str | None = None
        """Why the loop stopped, if it did."""
        self._size, self._loop, self._sets, self._context = size, loop, sets, context
        self._detector = DETECTOR
        self._episodes: dict[str, Path] = {}
        self._statistics: list[LabelStatistics] = []

    def collect(self, number: int) -> "TrainJob | None":
        """Collects and labels; returns the fine-tuning to do, None if the loop has stopped."""
        from experiments.cache.detector_stages import TrainJob, make_labels, score_labels
        from experiments.cache.episode_pool import link_dataset

        if self.stopped is not None:
            return None
        new = self._record(number)
        self._episodes.update(new)
        first = next(iter(self._episodes.values())).parent.name
        dataset = link_dataset(f"{self._sets.world}_loop-{self.seed}-{digest(first)}", self._episodes, self._context)
        teacher = SourceConfig(detector=DETECTOR)
        labels = make_labels(dataset, self.seed, self._context, sources=teacher, share_scenes=True, growing=True)
        pictures = pictures_by_episode(labels)
        self._statistics.append(label_statistics(_for_purpose("learn", new, pictures)))
        signs = asdict(self._statistics[-1])
        self.rounds.append({"round": number, "labels": score_labels(labels), "signs": signs})
        self.stopped = collapse_reason(self._statistics)
        if self.stopped is not None:
            return None
        size, title = TRAIN_SIZES[self._context.scale], f"the labels of {len(self.rounds)} rounds"
        learn, choose = (_for_purpose(purpose, self._episodes, pictures) for purpose in PURPOSES)
        replay, augment = self._sets.photographs()[0], size.augment[self._sets.world]
        return TrainJob(self._detector, learn, choose, replay, size.train, augment, self.seed, title)

    def deploy(self, detector: str, scores: dict[str, Any]) -> None:
        """Goes on with another detector, which has these scores."""
        self._detector = detector
        self.rounds[-1]["test"] = scores

    def _record(self, number: int) -> dict[str, Path]:
        """The episodes of a round, by names that tell them from those of all others."""
        from experiments.cache.episode_pool import EpisodePool, record

        world, found = self._sets.world, {}
        for place, (purpose, count) in enumerate(zip(PURPOSES, self._size.episodes[world], strict=True)):
            name, seed = f"{world}_round_{purpose}", FIRST_POOL_SEED + 1000 * self.seed + 2 * number + place
            guided = (self._detector, POLICY, self._loop.episodes_per_scene)
            pool = EpisodePool(name, WORLDS[world], self._loop.split, count, seed, *guided)
            for folder in record(pool, self._context):
                found[f"{number:02d}-{purpose}-{digest(folder.parent.name)[:8]}-{folder.name}"] = folder
        return found


def pictures_by_episode(labels: Path) -> "dict[str, list[AnnotatedPicture]]":
    """Labelled pictures of a label set, by the names of their episodes, with the labels that are learnt from."""
    from labeling.detectors.data.annotated_pictures import read_pictures
    from labeling.detectors.data.doubtful_labels import without_doubtful
    from labeling.io.label_set import read_label_set

    dataset = read_label_set(labels).dataset
    if dataset is None:
        raise ValueError(f"{labels} does not say which dataset it was made from")
    found: dict[str, list[AnnotatedPicture]] = defaultdict(list)
    for picture in without_doubtful(read_pictures(labels)):
        found[picture.file.relative_to(dataset).parts[0]].append(picture)
    return dict(found)


def _for_purpose(
    purpose: str, episodes: Iterable[str], pictures: "Mapping[str, Sequence[AnnotatedPicture]]"
) -> "list[AnnotatedPicture]":
    """Of the episodes that are there to learn from, or to choose the best network by."""
    return [one for name in episodes if f"-{purpose}-" in name for one in pictures[name]]


def label_statistics(pictures: "Sequence[AnnotatedPicture]") -> LabelStatistics:
    """What labelled pictures say about themselves.

    Args:
        pictures: at least one.
    """
    labels = [one for picture in pictures for one in picture.annotations if not one.ignore]
    counts = Counter(one.category for one in labels)
    return LabelStatistics(
        labels_per_view=len(labels) / len(pictures),
        confidence=statistics.fmean(one.weight for one in labels) if labels else 0.0,
        shares={name: count / len(labels) for name, count in sorted(counts.items())},
    )


def collapse_reason(rounds: Sequence[LabelStatistics]) -> str | None:
    """Whether the labels of the latest round have collapsed, and how.

    Args:
        rounds: all rounds so far, at least one.

    Returns:
        A sentence, None if they have not.
    """
    *before, now = rounds
    if now.labels_per_view == 0.0:
        return "there are no labels"
    if not before:
        return None
    most, surest = max(one.labels_per_view for one in before), max(one.confidence for one in before)
    if now.labels_per_view < MIN_LABEL_RATIO * most:
        return f"labels per view fell from {most:.2f} to {now.labels_per_view:.2f}"
    if now.confidence < surest - MAX_CONFIDENCE_DROP:
        return f"the mean confidence of labels fell from {surest:.2f} to {now.confidence:.2f}"
    name = max(now.shares, key=lambda one: now.shares[one])
    if now.shares[name] >= MAX_CATEGORY_SHARE > before[0].shares.get(name, 0.0):
        return f"{now.shares[name]:.0%} of all labels are {name}"
    return None


LOOPS = {
    "never_ending": SelfTrainingLoop("rooms", "endless", 3),
    "never_ending_streets": SelfTrainingLoop("streets", "train", 1),
}
for _name, _loop in LOOPS.items():
    _what = "rounds of collecting, labelling, fine-tuning and redeploying; what labels, detector and photographs show"
    experiment(_name, f"{_loop.world}: {_what}", pages=("results",))(_loop.run)
