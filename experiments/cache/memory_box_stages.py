"""Stages of experiments with boxes on memories: train networks, score boxes of scenes. Outcomes are kept."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from experiments.cache.origin import training_machine
from experiments.cache.stages import RunContext, cached, digest
from labeling.memory.settings.box_settings import TrainBoxesConfig
from labeling.memory.settings.grid_spec import Around
from labeling.memory.settings.memory_spec import MemorySize, Model
from labeling.runtime.code_digest import code_digest

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.detectors3d.several_views import SceneDetection3d
    from labeling.memory.boxes.box_detector import MemoryBoxDetector
    from labeling.memory.boxes.labelled_scenes import LabelledScene

Looks = Literal["memory", "memory, poses by ICP", "one view", "fused views"]
"""How boxes of a scene are found: by a memory of all given views, with recorded poses or with those of ICP from view to
view; by a frustum PointNet from the first of them, or by one from each of them, fused."""


@dataclass(frozen=True)
class BoxJob:
    """A training of a network that finds boxes in a memory."""

    model: Model
    learn: tuple[Path, ...]
    """Label sets, or episodes with ground truth."""
    choose: tuple[Path, ...]
    """The network that does best on these is kept; of none, the last."""
    size: MemorySize
    train: TrainBoxesConfig
    """Its seed is replaced."""
    seed: int
    title: str
    begun: str | None = None
    """Folder of a memory's run whose weights are begun with; None for random ones."""
    categories: tuple[str, ...] | None = None
    """Others are left out; None keeps all."""


def train_box_nets(jobs: Sequence[BoxJob], context: RunContext) -> list[str]:
    """Trains networks in parallel.

    Returns:
        Folders of their runs, in order.
    """
    code, machine, keyed = code_digest(_train), training_machine(context.where), []
    for job in jobs:
        begun = None if job.begun is None else Path(job.begun).name  # a digest of all that it was made from
        settings = [job.model, asdict(job.size), asdict(replace(job.train, seed=job.seed)), begun, job.categories]
        key = digest([[_content(path) for path in paths] for paths in (job.learn, job.choose)], settings, code, machine)
        keyed.append((key, (job, context.cache / "memory_boxes" / key)))

    def reads(task: tuple[BoxJob, Path]) -> list[Path]:
        from experiments.cache.box_stages import with_dataset

        job, out = task
        begun = [] if job.begun is None else [Path(job.begun)]
        return [*(place for path in (*job.learn, *job.choose) for place in with_dataset(path)), *begun, out]

    cached("memory_boxes", _train, keyed, context, "training boxes on memories", reads=reads, gpus=True)
    return [str(out) for _, (_, out) in keyed]


def _content(folder: Path) -> list[str]:
    """Names of label sets, datasets and episodes change with what they hold, but for how many episodes there are."""
    inner = [] if (folder / "transforms.json").is_file() else [one.name for one in folder.iterdir() if one.is_dir()]
    return [folder.parent.name, folder.name, *sorted(inner)]


def _train(task: tuple[BoxJob, Path]) -> dict[str, Any]:
    from labeling.detectors.registry import choose_device
    from labeling.memory.boxes.box_training import BoxTask
    from labeling.memory.boxes.labelled_scenes import read_labelled_scenes
    from labeling.memory.networks.weights import load_memory
    from labeling.training.loop import train

    job, out = task
    title, spec, around = f"{job.title}, seed {job.seed}", job.size.spec(job.model), job.train.around
    learn, choose = (
        [_of_categories(one, job.categories) for one in read_labelled_scenes(paths, spec, around)[0]] if paths else []
        for paths in (job.learn, job.choose)
    )
    memory = spec if job.begun is None else load_memory(Path(job.begun))
    boxes = BoxTask(memory, learn, choose, replace(job.train, seed=job.seed), choose_device(), {"labels": job.title})
    progress = train(boxes, out, lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True))
    return {"title": title, "scenes": [len(learn), len(choose)], "history": progress.history}


def _of_categories(labelled: "LabelledScene", categories: tuple[str, ...] | None) -> "LabelledScene":
    if categories is None:
        return labelled
    return replace(labelled, objects=tuple(one for one in labelled.objects if one.category in categories))


@dataclass(frozen=True)
class SceneScores:
    """What is to be scored: one method on the scenes of some episodes."""

    looks: Looks
    detector: str
    """Folder of a run: of boxes on a memory, or of a frustum PointNet, which lifts the detections of the episodes."""
    episodes: tuple[Path, ...]
    """With ground truth."""
    size: MemorySize
    """Of the grid in which objects are to be found."""
    around: Around
    inputs: tuple[int, ...]
    """Numbers of views that are given."""
    categories: tuple[str, ...]


def score_scenes(jobs: Sequence[SceneScores], context: RunContext) -> list[dict[str, Any]]:
    """AP of boxes of scenes.

    Returns:
        For each job, by the number of views given, ``ap25``, ``ap50`` and ``objects`` over what these views show
        (``shown``), and over what the largest number of views shows (``all``). What lies outside of the grid is left
        out.
    """
    code, keyed = code_digest(_score), []
    for job in jobs:
        episodes = [f"{path.parent.name}/{path.name}" for path in job.episodes]
        settings = [job.looks, Path(job.detector).name, asdict(job.size), job.around, job.inputs, job.categories]
        keyed.append((digest(episodes, settings, code), job))

    def reads(job: SceneScores) -> list[Path]:
        return [*job.episodes, Path(job.detector)]

    return cached("scene_box_scores", _score, keyed, context, "scoring boxes of scenes", reads=reads, gpus=True)


def _score(job: SceneScores) -> dict[str, Any]:
    from labeling.core.errors import EpisodeFormatError
    from labeling.io.episodes import read_episode
    from labeling.memory.boxes.box_evaluation import (
        average_precision_of_scenes,
        inside_grid,
        instances_to_find,
        spread_views,
    )
    from labeling.memory.boxes.labelled_scenes import true_scene
    from labeling.metrics.box_ap import BoxInstance

    find, grid = _finder(job), job.size.grid
    found: dict[int, list[list[SceneDetection3d]]] = {count: [] for count in job.inputs}
    truths: dict[tuple[str, int], list[list[BoxInstance]]] = {}
    left_out = []
    for folder in job.episodes:
        episode = read_episode(folder)
        try:
            labelled = true_scene(episode, job.size, job.around)
        except EpisodeFormatError as error:  # too few views look at the grid
            left_out.append(str(error))
            continue
        scene, most = labelled.scene, spread_views(labelled.scene.num_views, max(job.inputs))
        for count in job.inputs:
            chosen = spread_views(scene.num_views, count)
            boxes = find(episode, scene.view_index, chosen)
            inside = [one for one in boxes if inside_grid(one.box, scene, chosen[0], grid)]
            found[count].append([one for one in inside if one.category in job.categories])
            for kind, shown_by in (("shown", chosen), ("all", most)):
                wanted = instances_to_find(labelled, chosen, job.categories, grid, shown_by)
                truths.setdefault((kind, count), []).append(wanted)

    def scores(kind: str, count: int) -> dict[str, Any]:
        wanted = truths.get((kind, count), [])
        ap = average_precision_of_scenes(found[count], wanted)
        return {
            "ap25": ap.mean[0.25],
            "ap50": ap.mean[0.5],
            "objects": sum(not one.ignore for of_scene in wanted for one in of_scene),
            "per_class_ap25": {name: of_class[0.25] for name, of_class in ap.per_class.items()},
        }

    by_inputs = {str(count): {kind: scores(kind, count) for kind in ("shown", "all")} for count in job.inputs}
    return {"inputs": by_inputs, "scenes": len(next(iter(found.values()))), "left_out": left_out}


def _finder(job: SceneScores) -> "Callable[[Episode, Sequence[int], Sequence[int]], list[SceneDetection3d]]":
    """A function of an episode, its views that look at the grid, and which of those are given; boxes of the scene."""
    from labeling.detectors3d.several_views import fuse_views

    if job.looks in ("memory", "memory, poses by ICP"):
        from labeling.memory.boxes.box_detector import load_memory_detector

        memory = load_memory_detector(Path(job.detector))
        if job.looks == "memory":
            return lambda episode, looking, given: memory.find(episode, views=[looking[one] for one in given])
        return lambda episode, looking, given: _with_icp_poses(memory, episode, looking, given)

    from experiments.cache.box_stages import detections, load_detector_3d

    frustums = load_detector_3d(job.detector)

    def find(episode: "Episode", looking: Sequence[int], given: Sequence[int]) -> "list[SceneDetection3d]":
        used = [looking[one] for one in (given[:1] if job.looks == "one view" else given)]
        recorded = [one for one in detections(episode, "recorded", job.categories) if one.view_index in used]
        return fuse_views(frustums.lift(episode, recorded), len(used))

    return find


def _with_icp_poses(
    memory: "MemoryBoxDetector", episode: "Episode", looking: Sequence[int], given: Sequence[int]
) -> "list[SceneDetection3d]":
    """With the pose of the first given view, and those of the others as ICP has them; none if these are hopeless."""
    from labeling.core.errors import EpisodeFormatError, UsageError

    estimated = _icp_poses(episode, tuple(looking), looking[given[0]])
    try:
        return memory.find(estimated, views=given)
    except (EpisodeFormatError, UsageError):  # the views do not look at one place, if these poses were true
        return []


@lru_cache(maxsize=1)
def _icp_poses(episode: "Episode", looking: tuple[int, ...], anchor: int) -> "Episode":
    """The same for every number of given views, which take turns before the next episode."""
    from experiments.cache.egomotion import with_icp_poses

    return with_icp_poses(episode, looking, anchor)
