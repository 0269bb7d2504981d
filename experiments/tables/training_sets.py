"""What the tables of the thesis share: the episodes of a world, labels of them, and detectors trained on these.

Each is made when it is first asked for and kept in the cache, so that tables share what they have in common.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.cache import worlds
from experiments.cache.origin import MASKS_FROM
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES, WORLDS
from labeling.detectors.data.doubtful_labels import LEAST_CONFIDENCE
from labeling.detectors.networks.spec import PREDICTED_MASK_THRESHOLD
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PRESETS
from labeling.generator.settings.source_config import SourceConfig
from sbm_gym.worlds.splits import Split

if TYPE_CHECKING:
    from experiments.cache.detector_stages import TrainJob
    from experiments.cache.episode_pool import EpisodePool
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

Subset = Literal["learn", "choose", "val", "dev", "test", "wide", "final", "pooled"]
SPLITS: dict[Subset, Split] = {
    "learn": "train",
    "choose": "train",
    "val": "val",
    "dev": "endless",
    "test": "test",
    "wide": "wide",
    "final": "final",
}
"""To learn from, to choose settings of 3-D detectors by; to report on: validation scenes, some of the endless ones to
decide by, the thesis' few test scenes, many more, and as many that nothing has been decided by. Nothing learns from the
last five.
"""
PARTS: dict[Subset, tuple[Subset, ...]] = {"pooled": ("test", "wide")}
"""Subsets whose views are those of others, ranked together."""
SEEDS: dict[Subset, int] = {"choose": 1, "dev": 20}
"""Of the order of scenes, where it is not 0; that of ``dev`` differs from those of what learns in endless scenes."""
RECORDING_SEEDS = 100
"""So far apart are the seeds of two recordings of the same training scenes."""
ENDLESS_SEED = 40
"""Of the order of endless scenes, where these are learnt from."""
STREETS = {"erosions": 3, "outlier_spread": 2.0, "crop_m": 6.0, "max_crop_m": 6.0}
"""The thesis' own label settings for streets. Source: field notes."""
PER_CLASS = {"mask_ap50": "ap50", "mask_ap30": "ap30", "box_ap50": "box_ap50", "box_ap30": "box_ap30"}
"""AP over all categories -> what its parts by category are called after ``per_class_``."""
OF_DETECTORS = {"own_box_ap50": "own_box_ap50", "own_box_ap30": "own_box_ap30"}
"""The same of figures that labels do not have."""


@dataclass(frozen=True)
class LabelRecipe:
    """How labels are made to train on."""

    settings: LabelConfig = field(default_factory=LabelConfig)
    weak: bool = False
    """From one true mask per object, instead of confident detections."""
    shared: bool = False
    """What one episode has found is labelled in the others of its scene, too."""
    detector_recipe: str | None = None
    """From detections of the detector that was fine-tuned, with the same seed, on labels of this recipe; None takes
    those recorded with the episodes, of the pre-trained detector."""
    with_recorded: bool = False
    """From the recorded detections as well."""
    least_confidence: float = LEAST_CONFIDENCE
    """Labels below are not learnt from."""
    trust_scores: bool = False
    """The others are learnt to be there as surely as their scores say, not for sure."""


LABEL_RECIPES: dict[str, LabelRecipe] = {
    "sbm": LabelRecipe(),
    "shared": LabelRecipe(shared=True),
    "ignoring": LabelRecipe(LabelConfig(ignore_unconfirmed=0.3), shared=True, least_confidence=0.0, trust_scores=True),
    "second round": LabelRecipe(shared=True, detector_recipe="shared"),
    "both detectors": LabelRecipe(shared=True, detector_recipe="shared", with_recorded=True),
    "unfitted": LabelRecipe(PRESETS["unfitted"], shared=True),
    "weak": LabelRecipe(weak=True),
    "consistent": LabelRecipe(LabelConfig(consistency=True)),
    "paper": LabelRecipe(PRESETS["paper"]),
    "released": LabelRecipe(PRESETS["released"]),
}
TRUTH, ANNOTATED = "truth", "annotated views"
"""What a detector learns from besides labels of a recipe: ground truth, or only the masks that weak labels are made
from."""


@dataclass(frozen=True)
class Student:
    """A detector, and what it is fine-tuned on."""

    teacher: str | None
    """One of ``LABEL_RECIPES``, ``TRUTH`` or ``ANNOTATED``; None for the pre-trained detector as it is."""
    seed: int
    """Of labels and training."""
    new_categories: tuple[str, ...] = ()
    """Learnt beside those that it knew."""


class TrainingSets:
    """The episodes of one world, labels of them, and detectors trained on these."""

    def __init__(
        self,
        world: str,
        context: RunContext,
        policy: str = "ring",
        unseen_models: bool = False,
        new_categories: bool = False,
        as_command: bool = False,
        recording: int = 0,
        endless: int = 0,
    ) -> None:
        """Makes nothing yet.

        Args:
            world: one of ``WORLDS``.
            context: scale, and where everything is kept.
            policy: who moves.
            unseen_models: learn from scenes without the models of furniture and vehicles that final scenes show.
            new_categories: learn from as many episodes as categories take that no photograph has shown.
            as_command: fine-tune as ``labeling.finetune`` does without options, not as the scale has it.
            recording: another number, other episodes of the same training scenes; the same number, the same starts,
                whoever moves. What is reported on does not change.
            endless: learn from so many episodes of each of many scenes of the endless split; 0: from several of each of
                the few training scenes.
        """
        self.world, self._context, self._policy, self._unseen_models = world, context, policy, unseen_models
        self._endless = endless
        self._new_categories, self._recording = new_categories, recording
        size = SIZES[context.scale]
        self._size = size.as_command() if as_command else size
        self._label_sets: dict[tuple[Subset, str, int, str | None], Path] = {}

    def episodes(self, subset: Subset) -> list[Path]:
        """Folders of recorded episodes."""
        from experiments.cache.episode_pool import record

        return record(self.pool(subset), self._context)

    def pool(self, subset: Subset) -> "EpisodePool":
        """What is recorded to have its episodes."""
        from experiments.cache.episode_pool import EpisodePool

        learn, choose, report = self._size.episodes[self.world]
        if self._new_categories and self._size.new_episodes:
            learn = self._size.new_episodes
        wide, dev = self._size.wide[self.world], self._size.dev[self.world]
        counts = {"learn": learn, "choose": choose, "val": report, "dev": dev, "test": report}
        counts |= {"wide": wide, "final": wide}
        name, split, seed = f"{self.world}_{subset}", SPLITS[subset], SEEDS.get(subset, 0)
        per_scene = 1
        if split == "train":
            seed += RECORDING_SEEDS * self._recording
            if self._endless:
                split, seed, per_scene = "endless", seed + ENDLESS_SEED, self._endless
        env, unseen, who = WORLDS[self.world], self._unseen_models, (DETECTOR, self._policy)
        return EpisodePool(name, env, split, counts[subset], seed, *who, per_scene, unseen_models=unseen)

    def pool_record(self, subset: Subset) -> dict[str, Any]:
        """What the record of results says about them."""
        from experiments.cache.episode_pool import pool_record

        return pool_record(self.pool(subset), self.episodes(subset))

    def settings(self, new_categories: bool = False) -> dict[str, Any]:
        """Of training, with or without categories that no photograph has shown."""
        size = self._size
        train, augment = size.train_new() if new_categories else size.train, asdict(size.augment[self.world])
        return {
            "detector": DETECTOR,
            "train": asdict(train),
            "augment": augment,
            "photographs": size.photographs,
            MASKS_FROM: PREDICTED_MASK_THRESHOLD,
        }

    def labels(self, subset: Subset, recipe: str, seed: int, detector: str | None = None) -> Path:
        """A label set, made or brought up to date when it is first asked for.

        Args:
            subset: of the episodes.
            recipe: one of ``LABEL_RECIPES``.
            seed: of the label generator.
            detector: whose detections it is made from; None takes what the recipe says.
        """
        which = (subset, recipe, seed, detector)
        if which not in self._label_sets:
            self._label_sets[which] = self._make_labels(*which)
        return self._label_sets[which]

    def detectors(self, students: Sequence[Student]) -> list[str]:
        """Names of detectors; those that are missing are trained in parallel."""
        from experiments.cache.detector_stages import train_detectors

        recipes = {one: LABEL_RECIPES[one.teacher] for one in students if one.teacher in LABEL_RECIPES}
        earlier = [Student(used.detector_recipe, one.seed) for one, used in recipes.items() if used.detector_recipe]
        if earlier:  # all that later labels ask for, in parallel
            self.detectors(earlier)
        jobs = {one: self.train_job(one.teacher, one.seed, one.new_categories) for one in students if one.teacher}
        names = dict(zip(jobs, train_detectors(list(jobs.values()), self._context), strict=True))
        return [names.get(one, DETECTOR) for one in students]

    def train_job(self, teacher: str, seed: int, new_categories: tuple[str, ...] = ()) -> "TrainJob":
        """The fine-tuning of a ``Student``.

        The last network is kept: labels of few scenes may choose worse ones (docs/design-notes.md, "Which network is
        kept").
        """
        from experiments.cache.detector_stages import TrainJob

        train = self._size.train_new() if new_categories else self._size.train
        if teacher in LABEL_RECIPES and LABEL_RECIPES[teacher].trust_scores:
            train = replace(train, trust_scores=True)
        return TrainJob(
            DETECTOR,
            self.training_pictures("learn", teacher, seed),
            self.photographs()[0],
            train,
            self._size.augment[self.world],
            seed,
            f"{teacher} of {self._policy} in {self.world}",
            new_categories,
        )

    def train_and_score(
        self,
        runs: "Sequence[tuple[dict[str, Any], TrainJob]]",
        on: Literal["val", "dev"] = "val",
        also: "Mapping[str, Sequence[AnnotatedPicture]] | None" = None,
    ) -> dict[str, Any]:
        """Fine-tunes detectors and scores them on unseen scenes and photographs, beside the pre-trained one.

        Args:
            runs: what the record says about each, and the training.
            on: which scenes.
            also: more pictures to score them on, by what the record calls them.

        Returns:
            Scores ``before``, and for each of ``runs`` what the record says with its scores.
        """
        from experiments.cache.detector_stages import score_detectors, train_detectors

        trained = train_detectors([job for _, job in runs], self._context)
        scenes = {"val": "validation", "dev": "dev"}[on]
        pictures = {scenes: self.pictures(on), "photographs": self.photographs()[1], **(also or {})}
        before, *after = score_detectors([DETECTOR, *trained], pictures, self._context)
        records = [{**about, **scores} for (about, _), scores in zip(runs, after, strict=True)]
        return {"before": before, "runs": records}

    def training_pictures(self, subset: Subset, teacher: str, seed: int) -> "list[AnnotatedPicture]":
        """Annotated pictures to learn from, or to choose a network by.

        Raises:
            ValueError: for episodes of test scenes.
        """
        from labeling.detectors.data.annotated_pictures import read_pictures
        from labeling.detectors.data.doubtful_labels import without_doubtful

        if SPLITS.get(subset) != "train":
            raise ValueError(f"{subset} episodes are to report on; nothing may be trained on them")
        if teacher == TRUTH:
            return self.pictures(subset)
        if teacher == ANNOTATED:
            return annotated_views(self.episodes(subset), seed)
        labelled = read_pictures(self.labels(subset, teacher, seed))
        return without_doubtful(labelled, LABEL_RECIPES[teacher].least_confidence)

    def pictures(self, subset: Subset) -> "list[AnnotatedPicture]":
        """The views of episodes with their ground truth."""
        from labeling.detectors.data.annotated_pictures import read_pictures

        parts = PARTS.get(subset, (subset,))
        return [picture for part in parts for picture in read_pictures(self.episodes(part)[0].parent)]

    def photographs(self) -> "tuple[list[AnnotatedPicture], list[AnnotatedPicture]]":
        """Those that the detector was pre-trained on, and those held out."""
        return worlds.source_photographs(self._size.photographs, self._context)

    def label_scores(self, subset: Subset, recipe: str, seed: int, detector: str | None = None) -> dict[str, Any]:
        """How good labels are: AP of masks and boxes, over all categories and of each."""
        from labeling.evaluation.compare import evaluate_label_set

        metrics = evaluate_label_set(self.labels(subset, recipe, seed, detector)).metrics["pseudo_labels"]
        of_each = metrics["per_class"]
        return {
            **{name: metrics[name] for name in PER_CLASS},
            **{
                f"per_class_{saved}": {name: found[figure] for name, found in of_each.items()}
                for figure, saved in PER_CLASS.items()
            },
            "instances": {name: found["ground_truth_instances"] for name, found in of_each.items()},
        }

    def detector_scores(
        self, subset: Subset, detectors: Sequence[str], categories: Sequence[str] | None = None
    ) -> list[dict[str, Any]]:
        """How good each detector is on the views of episodes, and on the photographs held out.

        Args:
            subset: of the episodes.
            detectors: names.
            categories: those that count in the views; None are all.
        """
        from experiments.cache.detector_stages import score_detectors
        from labeling.detectors.data.annotated_pictures import with_annotations

        pictures = self.pictures(subset)
        if categories is not None:  # what is annotated nowhere is not looked for
            pictures = with_annotations(pictures, lambda one: one if one.category in categories else None)
        counts = Counter(one.category for picture in pictures for one in picture.annotations if not one.ignore)
        sets = {"views": pictures, "photographs": self.photographs()[1]}
        return [
            {
                **{name: value for name, value in found["views"].items() if name not in ("pictures", "objects")},
                "instances": {name: counts[name] for name in found["views"]["per_class_ap50"]},
                "photographs_ap50": found["photographs"]["mask_ap50"],
            }
            for found in score_detectors(detectors, sets, self._context)
        ]

    def _make_labels(self, subset: Subset, recipe: str, seed: int, detector: str | None) -> Path:
        from experiments.cache.detector_stages import make_labels

        made = LABEL_RECIPES[recipe]
        if made.detector_recipe is not None and detector is None:
            (detector,) = self.detectors([Student(made.detector_recipe, seed)])
        settings, sources = made.settings, SourceConfig(detector=detector, with_recorded=made.with_recorded)
        if self.world == "streets" and not settings.fuse_views:
            settings = replace(settings, **STREETS)
        if made.weak:
            sources = SourceConfig(weak="one-view")
        return make_labels(self.episodes(subset), seed, self._context, settings, sources, made.shared)


def known_categories() -> tuple[str, ...]:
    """Those that the 2-D detector has a name for."""
    from labeling.detectors.registry import load_detector

    names = load_detector(DETECTOR).categories
    if names is None:
        raise ValueError(f"{DETECTOR} does not say what it knows")
    return tuple(sorted(names))


def annotated_views(episodes: Sequence[Path], seed: int) -> "list[AnnotatedPicture]":
    """Only what a person has drawn for weak labels: one true mask of each object.

    Args:
        episodes: with ground truth.
        seed: of the label generator, which chooses the views.

    Returns:
        The views in which something was drawn. What else they show is marked as region to ignore: nobody has drawn it
        there.
    """
    from labeling.core.rle import encode_mask
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture, Annotation
    from labeling.generator.objects.weak_supervision import one_view_per_object
    from labeling.io.episodes import read_episode

    found = []
    for folder in episodes:
        episode = read_episode(folder)
        truths = episode.ground_truth or ()
        drawn = one_view_per_object(truths, episode.depth_m, LabelConfig().min_mask_px, seed, episode.name)
        for view in sorted({one.view_index for one in drawn}):
            masks = [one for one in drawn if one.view_index == view]
            known = [Annotation(one.category, encode_mask(one.mask)) for one in masks]
            rest = [
                Annotation(one.category, encode_mask(one.modal), ignore=True)
                for one in truths
                if one.view_index == view and not any(np.array_equal(one.modal, mask.mask) for mask in masks)
            ]
            found.append(AnnotatedPicture(folder / episode.file_names[view], episode.size, (*known, *rest)))
    return found
