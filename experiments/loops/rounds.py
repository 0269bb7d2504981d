"""The rounds of one seed: record with the detector there is, label, and say what is to be learnt."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from experiments.cache.stages import RunContext, Scale, digest
from experiments.cache.worlds import DETECTOR, WORLDS
from experiments.cache.worlds import SIZES as TRAIN_SIZES
from experiments.loops.signs import LabelStatistics, collapse_reason, label_statistics
from experiments.tables.label_errors import count_errors
from experiments.tables.training_sets import TrainingSets, known_categories
from labeling.generator.settings.source_config import SourceConfig

if TYPE_CHECKING:
    from experiments.cache.detector_stages import TrainJob
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

Split = Literal["train", "endless"]
POLICY = "ppo"
"""Who moves: the trained policy that comes with the project."""
FIRST_POOL_SEED = 1000
"""Seeds of the episodes of rounds count up from here, apart from those of all other experiments."""
LABELS, TRUTH = "labels", "truth"
"""What networks are taught by. It is the one that is taught by labels that guides the robot."""
SCORES: dict[str, str] = {LABELS: "test", TRUTH: "ceiling"}
"""What the record of a round calls the figures of either on unseen scenes."""


@dataclass(frozen=True)
class LoopSize:
    """How much of everything a scale has."""

    rounds: int
    episodes: dict[str, int]
    """By world: episodes of a round."""


SIZES: dict[Scale, LoopSize] = {
    "smoke": LoopSize(2, {"rooms": 1, "streets": 1}),
    "quick": LoopSize(10, {"rooms": 12, "streets": 8}),
    "standard": LoopSize(15, {"rooms": 20, "streets": 12}),
    "full": LoopSize(10, {"rooms": 40, "streets": 30}),
}


def num_rounds(context: RunContext) -> int:
    """How many rounds a loop goes at most."""
    return SIZES[context.scale].rounds if context.rounds is None else context.rounds


@dataclass(frozen=True)
class Places:
    """Where the episodes of a loop are recorded."""

    world: str
    split: Split
    """In the few named scenes, to which later rounds come back, or in others every time."""
    episodes_per_scene: int
    """Begun in different places of a scene before the next."""


class SeedRounds:
    """The rounds of one seed."""

    def __init__(self, seed: int, places: Places, sets: TrainingSets, context: RunContext) -> None:
        """Begins with the pre-trained detector.

        Args:
            seed: of episodes, labels and training.
            places: where the robot goes.
            sets: of the world; its photographs are mixed in.
            context: scale, and where everything is kept.
        """
        self.seed = seed
        self.records: list[dict[str, Any]] = []
        """Figures so far, round by round."""
        self.stopped: str | None = None
        """Why the rounds have stopped, if they have."""
        self.trained: list[str] = []
        """Names of all networks that were deployed."""
        self._places, self._sets, self._context = places, sets, context
        self._detectors = dict.fromkeys(SCORES, DETECTOR)
        self._episodes: dict[str, Path] = {}
        self._scenes: dict[str, str] = {}
        """By episode."""
        self._views: dict[str, dict[str, list[AnnotatedPicture]]] = {name: {} for name in SCORES}
        """By teacher and episode."""
        self._signs: list[LabelStatistics] = []

    def collect(self, number: int) -> "dict[str, TrainJob]":
        """Records and labels a round.

        Args:
            number: of the round, from 1.

        Returns:
            The fine-tunings to do, by teacher: of the networks of the round before. Empty if labels have collapsed.
        """
        from experiments.cache.detector_stages import score_labels

        if self.stopped is not None:
            return {}
        new = self._record(number)
        self._episodes.update(new)
        self._scenes.update({name: _scene(folder) for name, folder in new.items()})
        labels = self._label(new)
        taught, true = (self.views(teacher, new) for teacher in (LABELS, TRUTH))
        self._signs.append(label_statistics(taught))
        self.records.append(
            {
                "round": number,
                "labels": score_labels(labels),
                "errors": count_errors(taught, true, known_categories()),
                "signs": asdict(self._signs[-1]),
            }
        )
        self.stopped = collapse_reason(self._signs)
        return {} if self.stopped is not None else {teacher: self.train_job(teacher) for teacher in SCORES}

    def deploy(self, teacher: str, detector: str, scores: dict[str, Any]) -> None:
        """Goes on with another network.

        Args:
            teacher: one of ``SCORES``.
            detector: its name.
            scores: on unseen scenes.
        """
        self._detectors[teacher] = detector
        self.trained.append(detector)
        self.records[-1][SCORES[teacher]] = scores

    def views(self, teacher: str, episodes: Iterable[str] | None = None) -> "list[AnnotatedPicture]":
        """Annotated views.

        Args:
            teacher: whose annotations.
            episodes: names; None takes all so far.
        """
        names = self._episodes if episodes is None else episodes
        return [view for name in names for view in self._views[teacher][name]]

    def train_job(self, teacher: str) -> "TrainJob":
        """The fine-tuning that goes on with the network of the round before, on the views of all rounds so far."""
        return self._job(self._detectors[teacher], teacher, None, 1, f"{teacher} of {len(self.records)} rounds")

    def anew(self, episodes: Iterable[str] | None, title: str, teacher: str = LABELS) -> "TrainJob":
        """The fine-tuning of the pre-trained network, in as many batches as all rounds so far have together.

        Args:
            episodes: names of those to learn from; None takes all so far.
            title: for the records.
            teacher: one of ``SCORES``.
        """
        return self._job(DETECTOR, teacher, episodes, len(self.records), title)

    def episodes_of(self, number: int) -> list[str]:
        """Names of the episodes of a round, from 1."""
        return [name for name in self._episodes if name.startswith(f"{number:02d}-")]

    def _job(self, detector: str, teacher: str, episodes: Iterable[str] | None, rounds: int, title: str) -> "TrainJob":
        from experiments.cache.detector_stages import TrainJob

        size = TRAIN_SIZES[self._context.scale]
        learn = self.views(teacher, episodes)
        replay, augment = self._sets.photographs()[0], size.augment[self._places.world]
        train = replace(size.train, iterations=rounds * size.train.iterations)
        return TrainJob(detector, learn, replay, train, augment, self.seed, title)

    def _record(self, number: int) -> dict[str, Path]:
        """The episodes of a round, by names that tell them from those of all others."""
        from experiments.cache.episode_pool import EpisodePool, record

        world, seed = self._places.world, FIRST_POOL_SEED + 1000 * self.seed + number
        guided = (self._detectors[LABELS], POLICY, self._places.episodes_per_scene)
        count = SIZES[self._context.scale].episodes[world]
        pool = EpisodePool(f"{world}_round", WORLDS[world], self._places.split, count, seed, *guided)
        return {
            f"{number:02d}-{digest(folder.parent.name)[:8]}-{folder.name}": folder
            for folder in record(pool, self._context)
        }

    def _label(self, new: Iterable[str]) -> Path:
        """Labels what a round has recorded, and anew what earlier ones have in the same scenes; returns the label set.

        What is learnt from these is replaced.
        """
        from experiments.cache.detector_stages import make_labels
        from experiments.cache.episode_pool import link_dataset
        from labeling.detectors.data.annotated_pictures import read_pictures
        from labeling.detectors.data.doubtful_labels import without_doubtful

        scenes = {self._scenes[name] for name in new}
        together = {name: folder for name, folder in self._episodes.items() if self._scenes[name] in scenes}
        name = f"{self._places.world}_loop-{self.seed}-{digest(sorted(together))[:16]}"
        dataset = link_dataset(name, together, self._context)
        teacher = SourceConfig(detector=DETECTOR)
        labels = make_labels(dataset, self.seed, self._context, sources=teacher, share_scenes=True)
        annotated = {LABELS: without_doubtful(read_pictures(labels)), TRUTH: read_pictures(dataset[0].parent)}
        for one, pictures in annotated.items():
            views: dict[str, list[AnnotatedPicture]] = defaultdict(list)
            for picture in pictures:
                views[picture.file.parents[1].name].append(picture)
            self._views[one].update({name: views[name] for name in together})
        return labels


def _scene(episode: Path) -> str:
    import json

    return json.loads((episode / "episode.json").read_text(encoding="utf-8"))["scene"]
