"""Stages of experiments with 3-D boxes: train frustum PointNets, lift detections, score. Outcomes are kept."""

import sys
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.cache.stages import RunContext, cached, digest
from labeling.detectors3d.config import Augment3dConfig, Train3dConfig
from labeling.runtime.code_digest import code_digest

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.core.types import Box3d, Detection, GroundTruth
    from labeling.detectors3d.base import Detection3d, Detector3d
    from labeling.metrics.box_ap import BoxInstance

MaskSource = Literal["recorded", "told"]
"""Whose masks are lifted: of the detections that were recorded with the episodes, or of ground truth ("told")."""
EDGES_M = {"rooms": (0.0, 2.0, 3.0, 5.0, 50.0), "streets": (0.0, 10.0, 20.0, 30.0, 50.0)}
"""Of the bins of distance in which AP is told apart, by world."""


@dataclass(frozen=True)
class TrainJob3d:
    """A training of a frustum PointNet."""

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


def train_detectors_3d(jobs: Sequence[TrainJob3d], context: RunContext) -> list[str]:
    """Trains frustum PointNets in parallel.

    Args:
        jobs: one for each.
        context: where to keep the runs.

    Returns:
        Names of the detectors, in order: the folders of their runs.
    """
    code, keyed = code_digest(_train), []
    for job in jobs:
        key = digest(
            [_content(job.learn), _content(job.choose), list(job.categories)],
            [asdict(replace(job.train, seed=job.seed)), asdict(job.augment), code],
        )
        keyed.append((key, (job, context.cache / "detectors3d" / key)))

    def reads(task: tuple[TrainJob3d, Path]) -> list[Path]:
        job, out = task  # in which an earlier run may have left a checkpoint to go on from
        return [*with_dataset(job.learn), *with_dataset(job.choose), out]

    cached("detectors_3d", _train, keyed, context, "training 3-D detectors", reads=reads, gpus=True)
    return [str(out) for _, (_, out) in keyed]


def _content(folder: Path) -> list[str]:
    """Names of label sets and of datasets change with what they hold, but for how many episodes there are."""
    return [folder.name, *sorted(path.name for path in folder.iterdir() if path.is_dir())]


def with_dataset(folder: Path) -> list[Path]:
    """Episodes, or a label set and the episodes that it was made from."""
    from labeling.formats.checked_json import read_json
    from labeling.io.file_names import SUMMARY_FILE
    from labeling.io.label_set import stated_dataset

    summary = folder / SUMMARY_FILE
    dataset = stated_dataset(folder, read_json(summary)) if summary.is_file() else None
    return [folder] if dataset is None else [folder, dataset]


def _train(task: tuple[TrainJob3d, Path]) -> dict[str, Any]:
    from labeling.detectors.registry import choose_device
    from labeling.detectors3d.frustum_samples import read_frustum_samples
    from labeling.detectors3d.frustum_training import FrustumTask
    from labeling.training.loop import train

    job, out = task
    title = f"{job.title}, seed {job.seed}"
    learn, choose = (
        [one for one in read_frustum_samples(path, job.seed) if one.category in job.categories]
        for path in (job.learn, job.choose)
    )
    config = replace(job.train, seed=job.seed)
    frustums = FrustumTask(learn, choose, config, job.augment, choose_device(), {"labels": job.title})
    state = train(frustums, out, lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True))
    return {"title": title, "folder": str(out), "objects": [len(learn), len(choose)], "history": state.history}


def score_box_targets(labels: Sequence[Path], episodes: Sequence[Path], context: RunContext) -> list[dict[str, Any]]:
    """How good the boxes of label sets are, by category: ``experiments.cache.box_targets`` of each."""
    names, code = [folder.name for folder in episodes], code_digest(_score_targets)
    jobs = [(digest(_content(one), names, code), (one, tuple(episodes))) for one in labels]

    def reads(task: tuple[Path, tuple[Path, ...]]) -> list[Path]:
        return [*with_dataset(task[0]), *task[1]]

    return cached("box_targets", _score_targets, jobs, context, "scoring box targets", reads=reads)


def _score_targets(task: tuple[Path, tuple[Path, ...]]) -> dict[str, Any]:
    from experiments.cache.box_targets import box_targets

    return box_targets(*task)


@dataclass(frozen=True)
class BoxEvaluation:
    """One 3-D detector on the views of some episodes."""

    world: str
    episodes: tuple[Path, ...]
    detector: str
    """``ldls``, ``ldls:SCALE``, or the folder of a run."""
    masks: MaskSource
    categories: tuple[str, ...]


def score_boxes(evaluations: Sequence[BoxEvaluation], context: RunContext) -> list[dict[str, Any]]:
    """AP of boxes, one record for each evaluation."""
    code, jobs = code_digest(_score), []
    for one in evaluations:
        names = [folder.parent.name + "/" + folder.name for folder in one.episodes]
        weights = load_detector_3d(one.detector).digest
        jobs.append((digest(one.world, names, weights, one.masks, list(one.categories), code), one))

    def reads(one: BoxEvaluation) -> list[Path]:
        return [*context.where.files_named(one.detector), *one.episodes]

    return cached("box_scores", _score, jobs, context, "scoring 3-D detectors", reads=reads, gpus=True)


def load_detector_3d(name: str) -> "Detector3d":
    """A 3-D detector by name; ``ldls:SCALE`` is LDLS with neighbours weighed over so many metres."""
    from labeling.detectors3d import registry
    from labeling.detectors3d.ldls import Ldls, LdlsConfig

    kind, _, scale = name.partition(":")
    return Ldls(LdlsConfig(scale_m=float(scale))) if kind == "ldls" and scale else registry.load_detector_3d(name)


def _score(evaluation: BoxEvaluation) -> dict[str, Any]:
    from labeling.io.episodes import read_episode
    from labeling.metrics.box_ap import average_precision_3d, average_precision_by_range

    scenes: dict[Hashable, str] = {}
    detector = load_detector_3d(evaluation.detector)
    found: list[BoxInstance] = []
    truths: list[BoxInstance] = []
    for folder in evaluation.episodes:
        episode = read_episode(folder)
        boxes = detector.lift(episode, detections(episode, evaluation.masks, evaluation.categories))
        found += [_instance(episode, one, one.box, confidence=one.confidence) for one in boxes]
        truths += true_instances(episode, evaluation.categories)
        scene = str(episode.metadata.get("scene", episode.name))
        scenes |= {(episode.name, view): scene for view in range(episode.num_views)}
    space, bird = (average_precision_3d(found, truths, kind=kind) for kind in ("3d", "bev"))
    edges = EDGES_M[evaluation.world]
    by_range = average_precision_by_range(found, truths, edges)
    counts = {name: sum(one.category == name and not one.ignore for one in truths) for name in evaluation.categories}
    percent = {t: f"ap{round(100 * t)}" for t in space.mean}
    return {
        **{percent[t]: value for t, value in space.mean.items()},
        **{f"bird_{percent[t]}": value for t, value in bird.mean.items()},
        **{f"per_class_{percent[t]}": {name: ap[t] for name, ap in space.per_class.items()} for t in space.mean},
        "instances": {name: count for name, count in counts.items() if count},
        "by_range": [
            {
                "from_m": low,
                "to_m": high,
                "objects": sum(low <= one.range_m < high and not one.ignore for one in truths),
                **{percent[t]: value for t, value in ap.mean.items()},
            }
            for (low, high), ap in by_range.items()
        ],
        "resampled": _resampled(found, truths, scenes),
    }


def _resampled(
    found: "Sequence[BoxInstance]", truths: "Sequence[BoxInstance]", scenes: Mapping[Hashable, str]
) -> dict[str, list[float]] | None:
    """AP of scenes that are drawn again, by figure; None of few scenes: they do not tell how much scenes differ."""
    from labeling.metrics.box_ap import IOU_THRESHOLDS, ranked_box_matches
    from labeling.metrics.resampled_ap import MIN_SCENES, resample_matches

    if len(set(scenes.values())) < MIN_SCENES:
        return None
    draws = resample_matches(ranked_box_matches(found, truths), scenes, IOU_THRESHOLDS)
    return {f"ap{round(100 * t)}": np.nan_to_num(values).round(4).tolist() for t, values in draws.items()}


def detections(episode: "Episode", masks: MaskSource, categories: Sequence[str]) -> "list[Detection]":
    """The 2-D detections of an episode that are lifted."""
    from labeling.core.types import Detection

    if masks == "recorded":
        return [one for one in episode.detections or () if one.category in categories]
    return [
        Detection(one.view_index, one.category, 1.0, one.modal)
        for one in episode.ground_truth or ()
        if one.category in categories and one.modal.any() and not one.ignore
    ]


def true_instances(episode: "Episode", categories: Sequence[str]) -> "list[BoxInstance]":
    """What there is to find, of some categories."""
    return [
        _instance(episode, one, one.box_3d, ignore=one.ignore)
        for one in episode.ground_truth or ()
        if one.category in categories and one.box_3d is not None and one.modal.any()
    ]


def _instance(episode: "Episode", one: "Detection3d | GroundTruth", box: "Box3d", **more: Any) -> "BoxInstance":
    from labeling.metrics.box_ap import BoxInstance

    range_m = float(np.linalg.norm(box.centre_m - episode.camera_to_world[one.view_index, :3, 3]))
    return BoxInstance((episode.name, one.view_index), one.category, box, range_m=range_m, **more)
