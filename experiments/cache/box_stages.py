"""Stages of experiments with 3-D boxes: train frustum PointNets, lift detections, score. None is done twice."""

import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.cache.detector_stages import side_by_side
from experiments.cache.stages import Workplace, digest
from labeling.detectors3d.train_config import Augment3dConfig, Train3dConfig
from labeling.runtime.code_digest import code_digest

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.core.types import Detection
    from labeling.detectors3d.base import Detection3d, Detector3d
    from labeling.metrics.box_ap import BoxInstance

TRAIN_CODE = ("labeling.detectors3d.training_run", "labeling.detectors3d.frustum_dataset")
TARGET_CODE = ("experiments.cache.box_targets", "labeling.detectors3d.frustum_dataset", "labeling.core.boxes3d")
SCORE_CODE = (
    "labeling.detectors3d.registry",
    "labeling.metrics.box_ap",
    "labeling.io.episodes",
    "experiments.cache.box_stages",
)
Finder = Literal["recorded", "told"]
"""Who finds objects in pictures: the detector whose detections were recorded with the episodes, or ground truth."""
EDGES_M = {"rooms": (0.0, 2.0, 3.0, 5.0, 50.0), "streets": (0.0, 10.0, 20.0, 30.0, 50.0)}
"""Between distances that are told apart."""


@dataclass(frozen=True)
class Course3d:
    """What a frustum PointNet is to learn, and how."""

    learn: Path
    """A label set, or episodes with ground truth."""
    choose: Path
    """The network that does best on these is kept."""
    categories: tuple[str, ...]
    """Others are left out."""
    train: Train3dConfig
    """Its seed is replaced."""
    augment: Augment3dConfig
    seed: int
    title: str


def taught_3d(courses: Sequence[Course3d], workplace: Workplace) -> list[str]:
    """Trains frustum PointNets side by side.

    Args:
        courses: one for each.
        workplace: where to keep the runs.

    Returns:
        Names of the detectors, in order: the folders of their runs.
    """
    code, outs = code_digest(*TRAIN_CODE), []
    missing: dict[str, tuple[Course3d, Workplace, str]] = {}
    for course in courses:
        key = digest(
            [_content(course.learn), _content(course.choose), list(course.categories)],
            [asdict(replace(course.train, seed=course.seed)), asdict(course.augment), code],
        )
        outs.append(str(workplace.cache / "detectors3d" / key))
        if not workplace.store.has("taught_3d", key):
            missing[key] = (course, workplace, key)
    side_by_side(_teach, list(missing.values()), workplace, "training 3-D detectors")
    return outs


def _content(folder: Path) -> list[str]:
    """Names of label sets and of datasets change with what they hold, but for how many episodes there are."""
    return [folder.name, *sorted(path.name for path in folder.iterdir() if path.is_dir())]


def _teach(task: tuple[Course3d, Workplace, str]) -> None:
    from labeling.detectors.registry import choose_device
    from labeling.detectors3d.frustum_dataset import read_lessons
    from labeling.detectors3d.training_run import train

    course, workplace, key = task
    title, out = f"{course.title}, seed {course.seed}", workplace.cache / "detectors3d" / key
    learn, choose = (
        [one for one in read_lessons(path, course.seed) if one.category in course.categories]
        for path in (course.learn, course.choose)
    )
    state = train(
        learn,
        choose,
        out,
        replace(course.train, seed=course.seed),
        course.augment,
        choose_device(),
        {"labels": course.title},
        lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True),
    )
    about = {"title": title, "folder": str(out), "objects": [len(learn), len(choose)], "history": state.history}
    workplace.store.write("taught_3d", key, about)


def target_scores(labels: Sequence[Path], episodes: Sequence[Path], workplace: Workplace) -> list[dict[str, Any]]:
    """How good the boxes are that label sets teach, by category: ``experiments.cache.box_targets`` of each."""
    code = code_digest(*TARGET_CODE)
    keys = [digest(_content(one), [folder.name for folder in episodes], code) for one in labels]
    missing = {
        key: (one, tuple(episodes), workplace, key)
        for one, key in zip(labels, keys, strict=True)
        if not workplace.store.has("box_targets", key)
    }
    side_by_side(_compare, list(missing.values()), workplace, "comparing box targets")
    return [workplace.store.read("box_targets", key) for key in keys]


def _compare(task: tuple[Path, tuple[Path, ...], Workplace, str]) -> None:
    from experiments.cache.box_targets import box_targets

    labels, episodes, workplace, key = task
    workplace.store.write("box_targets", key, box_targets(labels, episodes))


@dataclass(frozen=True)
class Trial:
    """One 3-D detector on the views of some episodes."""

    world: str
    episodes: tuple[Path, ...]
    detector: str
    """``ldls``, ``ldls:SCALE``, or the folder of a run."""
    finder: Finder
    categories: tuple[str, ...]

    def key(self) -> str:
        """Changes with all that decides the outcome."""
        names = [folder.parent.name + "/" + folder.name for folder in self.episodes]
        mark = loaded(self.detector).digest
        return digest(self.world, names, mark, self.finder, list(self.categories), code_digest(*SCORE_CODE))


def box_scores(trials: Sequence[Trial], workplace: Workplace) -> list[dict[str, Any]]:
    """AP of boxes, one record for each trial."""
    keys = [trial.key() for trial in trials]
    missing = {
        key: (trial, workplace, key)
        for trial, key in zip(trials, keys, strict=True)
        if not workplace.store.has("box_scores", key)
    }
    side_by_side(_score, list(missing.values()), workplace, "trying 3-D detectors")
    return [workplace.store.read("box_scores", key) for key in keys]


def loaded(name: str) -> "Detector3d":
    """A 3-D detector by name; ``ldls:SCALE`` is LDLS with neighbours weighed over so many metres."""
    from labeling.detectors3d.ldls import Ldls, LdlsConfig
    from labeling.detectors3d.registry import load_detector_3d

    kind, _, scale = name.partition(":")
    return Ldls(LdlsConfig(scale_m=float(scale))) if kind == "ldls" and scale else load_detector_3d(name)


def _score(task: tuple[Trial, Workplace, str]) -> None:
    from labeling.io.episodes import read_episode
    from labeling.metrics.box_ap import average_precision_3d, average_precision_by_range

    trial, workplace, key = task
    detector = loaded(trial.detector)
    found: list[BoxInstance] = []
    truths: list[BoxInstance] = []
    for folder in trial.episodes:
        episode = read_episode(folder)
        found += instances(episode, detector.lift(episode, detections(episode, trial.finder, trial.categories)))
        truths += true_instances(episode, trial.categories)
    space, bird = (average_precision_3d(found, truths, kind=kind) for kind in ("3d", "bird"))
    edges = EDGES_M[trial.world]
    by_range = average_precision_by_range(found, truths, edges)
    counts = {name: sum(one.category == name and not one.ignore for one in truths) for name in trial.categories}
    content = {
        **{f"ap{round(100 * t)}": value for t, value in space.mean.items()},
        **{f"bird_ap{round(100 * t)}": value for t, value in bird.mean.items()},
        **{
            f"per_class_ap{round(100 * t)}": {name: of_class[t] for name, of_class in space.per_class.items()}
            for t in space.mean
        },
        "instances": {name: count for name, count in counts.items() if count},
        "by_range": [
            {
                "from_m": low,
                "to_m": high,
                "objects": sum(low <= one.range_m < high and not one.ignore for one in truths),
                **{f"ap{round(100 * t)}": value for t, value in ap.mean.items()},
            }
            for (low, high), ap in by_range.items()
        ],
    }
    workplace.store.write("box_scores", key, content)


def detections(episode: "Episode", finder: Finder, categories: Sequence[str]) -> "list[Detection]":
    """What is found in the pictures of an episode."""
    from labeling.core.types import Detection

    if finder == "recorded":
        return [one for one in episode.detections or () if one.category in categories]
    return [
        Detection(one.view_index, one.category, 1.0, one.modal)
        for one in episode.ground_truth or ()
        if one.category in categories and one.modal.any() and not one.ignore
    ]


def instances(episode: "Episode", boxes: "Sequence[Detection3d]") -> "list[BoxInstance]":
    """Boxes as the metrics want them."""
    from labeling.metrics.box_ap import BoxInstance

    return [
        BoxInstance(
            (episode.name, one.view_index),
            one.category,
            one.box,
            one.confidence,
            _range_m(episode, one.view_index, one.box.centre_m),
        )
        for one in boxes
    ]


def true_instances(episode: "Episode", categories: Sequence[str]) -> "list[BoxInstance]":
    """What there is to find, of some categories."""
    from labeling.metrics.box_ap import BoxInstance

    return [
        BoxInstance(
            (episode.name, one.view_index),
            one.category,
            one.box_3d,
            range_m=_range_m(episode, one.view_index, one.box_3d.centre_m),
            ignore=one.ignore,
        )
        for one in episode.ground_truth or ()
        if one.category in categories and one.box_3d is not None and one.modal.any()
    ]


def _range_m(episode: "Episode", view: int, centre_m: np.ndarray) -> float:
    return float(np.linalg.norm(centre_m - episode.camera_to_world[view, :3, 3]))
