"""What the tables of the thesis share: the episodes of a world, labels of them, and detectors taught with these.

Each is made when it is first asked for and kept in the cache, so that tables share what they have in common.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.cache.stages import Workplace
from experiments.cache.worlds import DETECTOR, WORLDS
from experiments.tables import fine_tuning
from experiments.tables.fine_tuning import SIZES
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PRESETS
from labeling.generator.settings.source_config import SourceConfig

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

Part = Literal["learn", "choose", "test", "wide"]
SPLITS: dict[Part, Literal["train", "test", "wide"]] = {
    "learn": "train",
    "choose": "train",
    "test": "test",
    "wide": "wide",
}
"""To learn from, to choose the best network by, to report on: the thesis' few test scenes, and many more. Labels of
these teach nobody."""
POOL_SEEDS: dict[Part, int] = {"learn": 0, "choose": 1, "test": 0, "wide": 0}
NOVEL = ("cushion", "nightstand", "shelf", "beanbag")
"""Categories that no photograph has taught. Source: thesis A.6."""
STREETS = {"erosions": 3, "outlier_spread": 2.0, "crop_m": 6.0, "max_crop_m": 6.0}
"""The thesis' own label settings for streets. Source: field notes."""


@dataclass(frozen=True)
class Kind:
    """A way to make labels."""

    settings: LabelConfig = field(default_factory=LabelConfig)
    weak: bool = False
    """From one true mask per object, instead of confident detections."""
    shared: bool = False
    """What one episode has found is labelled in the others of its scene, too."""
    found_by: str | None = None
    """The kind of labels that taught, with the same seed, the detector whose detections these are made from; None takes
    those recorded with the episodes, of the pre-trained detector."""
    with_recorded: bool = False
    """Made from the recorded detections as well."""
    least_sure: float = 0.0
    """Labels whose expected IoU is less teach neither that there is an object nor that there is none."""


LEAST_SURE = 0.5
"""Of labels in rooms whose expected IoU is less, about half are wrong."""
KINDS: dict[str, Kind] = {
    "sbm": Kind(),
    "shared": Kind(shared=True),
    "second round": Kind(shared=True, found_by="shared"),
    "both detectors": Kind(shared=True, found_by="shared", with_recorded=True, least_sure=LEAST_SURE),
    "weak": Kind(weak=True),
    "consistent": Kind(LabelConfig(consistency=True)),
    "paper": Kind(PRESETS["paper"]),
    "released": Kind(PRESETS["released"]),
}
TRUTH, ANNOTATED = "truth", "annotated views"
TEACHERS = (*KINDS, TRUTH, ANNOTATED)
"""What a detector may learn from: labels of a kind; ground truth; or only the masks that weak labels are made from."""


@dataclass(frozen=True)
class Pupil:
    """A detector, and what it has learnt from."""

    teacher: str | None
    """One of ``TEACHERS``; None for the one that nothing here has taught."""
    seed: int
    """Of labels and training."""
    new_categories: tuple[str, ...] = ()
    """Taught beside those it knew."""


class Lessons:
    """One world."""

    def __init__(self, world: str, workplace: Workplace) -> None:
        """Makes nothing yet.

        Args:
            world: one of ``WORLDS``.
            workplace: scale, and where everything is kept.
        """
        self.world, self._workplace = world, workplace
        self._size = SIZES[workplace.scale]
        self._photographs: tuple[list[AnnotatedPicture], list[AnnotatedPicture]] | None = None
        self._label_sets: dict[tuple[Part, str, int, str | None], Path] = {}

    def episodes(self, part: Part) -> list[Path]:
        """Folders of recorded episodes."""
        from experiments.cache.episode_pool import record

        return record(self._pool(part), self._workplace)

    def about(self, part: Part) -> dict[str, Any]:
        """What a reader of figures wants to know about them."""
        from experiments.cache.episode_pool import about

        return about(self._pool(part), self.episodes(part))

    def settings(self, new_categories: bool = False) -> dict[str, Any]:
        """Of training, with or without categories that no photograph has taught."""
        size = self._size
        return {
            "detector": DETECTOR,
            "train": asdict(size.train_new() if new_categories else size.train),
            "augment": asdict(size.augment[self.world]),
            "photographs": size.photographs,
        }

    def labels(self, part: Part, kind: str, seed: int, detector: str | None = None) -> Path:
        """A label set, made or brought up to date when it is first asked for.

        Args:
            part: of which episodes.
            kind: one of ``KINDS``.
            seed: of the label generator.
            detector: whose detections it is made from; None takes what the kind says.
        """
        which = (part, kind, seed, detector)
        if which not in self._label_sets:
            self._label_sets[which] = self._label(*which)
        return self._label_sets[which]

    def detectors(self, pupils: Sequence[Pupil]) -> list[str]:
        """Names of detectors; those that are missing are taught side by side."""
        from experiments.cache.detector_stages import Course, taught

        teachers = {pupil: KINDS[pupil.teacher].found_by for pupil in pupils if pupil.teacher in KINDS}
        earlier = [Pupil(teacher, pupil.seed) for pupil, teacher in teachers.items() if teacher is not None]
        if earlier:  # all that later labels ask for, side by side
            self.detectors(earlier)
        taught_here = [pupil for pupil in dict.fromkeys(pupils) if pupil.teacher is not None]
        courses = [
            Course(
                DETECTOR,
                self.lesson("learn", pupil.teacher, pupil.seed),
                self.lesson("choose", pupil.teacher, pupil.seed),
                self.photographs()[0],
                self._size.train_new() if pupil.new_categories else self._size.train,
                self._size.augment[self.world],
                pupil.seed,
                f"{pupil.teacher} of {self.world}",
                pupil.new_categories,
            )
            for pupil in taught_here
            if pupil.teacher is not None
        ]
        names = dict(zip(taught_here, taught(courses, self._workplace), strict=True))
        return [names.get(pupil, DETECTOR) for pupil in pupils]

    def lesson(self, part: Part, teacher: str, seed: int) -> "list[AnnotatedPicture]":
        """Annotated pictures to learn from, or to choose a network by.

        Raises:
            ValueError: for episodes of test scenes.
        """
        from labeling.detectors.data.annotated_pictures import read_pictures

        if SPLITS[part] != "train":
            raise ValueError(f"{part} episodes teach nobody")
        if teacher == TRUTH:
            return self.pictures(part)
        if teacher == ANNOTATED:
            return annotated_views(self.episodes(part), seed)
        pictures = read_pictures(self.labels(part, teacher, seed))
        least_sure = KINDS[teacher].least_sure
        return sure_of(pictures, least_sure) if least_sure else pictures

    def pictures(self, part: Part) -> "list[AnnotatedPicture]":
        """The views of episodes with their ground truth."""
        from labeling.detectors.data.annotated_pictures import read_pictures

        return read_pictures(self.episodes(part)[0].parent)

    def photographs(self) -> "tuple[list[AnnotatedPicture], list[AnnotatedPicture]]":
        """Those that the detector was pre-trained on, and those held out."""
        if self._photographs is None:
            self._photographs = fine_tuning.replayed_photographs(self._size.photographs, self._workplace)
        return self._photographs

    def label_figures(self, part: Part, kind: str, seed: int, detector: str | None = None) -> dict[str, Any]:
        """How good labels are: AP of masks and boxes, over all categories and of each."""
        from labeling.evaluation.compare import evaluate_label_set

        metrics = evaluate_label_set(self.labels(part, kind, seed, detector)).metrics["pseudo_labels"]
        of_each = metrics["per_class"]
        return {
            **{name: metrics[name] for name in ("mask_ap50", "mask_ap30", "box_ap50", "box_ap30")},
            **{
                f"per_class_{figure}": {name: found[f"mask_{figure}"] for name, found in of_each.items()}
                for figure in ("ap50", "ap30")
            },
            "instances": {name: found["ground_truth_instances"] for name, found in of_each.items()},
        }

    def detector_figures(self, part: Part, detectors: Sequence[str]) -> list[dict[str, Any]]:
        """How good each detector is on the views of episodes, and on the photographs held out."""
        from collections import Counter

        from experiments.cache.detector_stages import detector_scores

        pictures = self.pictures(part)
        counts = Counter(one.category for picture in pictures for one in picture.annotations if not one.ignore)
        sets = {"views": pictures, "photographs": self.photographs()[1]}
        return [
            {
                **{name: value for name, value in found["views"].items() if name not in ("pictures", "objects")},
                "instances": {name: counts[name] for name in found["views"]["per_class_ap50"]},
                "photographs_ap50": found["photographs"]["mask_ap50"],
            }
            for found in detector_scores(detectors, sets, self._workplace)
        ]

    def _label(self, part: Part, kind: str, seed: int, detector: str | None) -> Path:
        from experiments.cache.detector_stages import label

        made = KINDS[kind]
        if made.found_by is not None and detector is None:
            (detector,) = self.detectors([Pupil(made.found_by, seed)])
        settings = replace(made.settings, **STREETS) if self._is_thesis_in_streets(made) else made.settings
        sources = (
            SourceConfig(weak="one-view")
            if made.weak
            else SourceConfig(detector=detector, with_recorded=made.with_recorded)
        )
        return label(self.episodes(part), seed, self._workplace, settings, sources, made.shared)

    def _pool(self, part: Part) -> Any:
        from experiments.cache.episode_pool import Pool

        counts = (*self._size.episodes[self.world], self._size.wide[self.world])
        count = counts[("learn", "choose", "test", "wide").index(part)]
        name = f"{self.world}_{part}"
        return Pool(name, WORLDS[self.world], SPLITS[part], count, POOL_SEEDS[part], DETECTOR)

    def _is_thesis_in_streets(self, kind: Kind) -> bool:
        return self.world == "streets" and not kind.settings.fuse_views


def sure_of(pictures: "Sequence[AnnotatedPicture]", least_sure: float = LEAST_SURE) -> "list[AnnotatedPicture]":
    """Pictures whose unsure labels have become regions to ignore, as ``labeling.finetune --least-confidence`` does."""
    from labeling.detectors.data.annotated_pictures import with_annotations

    return with_annotations(pictures, lambda one: replace(one, ignore=one.ignore or one.weight < least_sure))


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
