"""Stages of experiments with 3-D memories: train them, score what they predict. Outcomes are kept."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from experiments.cache.origin import training_machine
from experiments.cache.stages import RunContext, cached, digest
from labeling.memory.settings.memory_spec import MemorySize, Model
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.runtime.code_digest import code_digest

if TYPE_CHECKING:
    from labeling.memory.view_prediction.evaluation import Scores
    from labeling.memory.view_prediction.scenes import SmallScene

_Scene = TypeVar("_Scene")
REPROJECTION, NO_CHANGE = "reprojection", "no change"
"""Names of methods that learn nothing: drawing points; in arithmetic, pictures of A itself."""


@dataclass(frozen=True)
class MemoryJob:
    """A training of a memory."""

    model: Model
    learn: tuple[Path, ...]
    """Episodes."""
    choose: tuple[Path, ...]
    """The network that does best on these is kept."""
    size: MemorySize
    train: TrainMemoryConfig
    """Its seed is replaced."""
    seed: int


def train_memories(jobs: Sequence[MemoryJob], context: RunContext) -> list[str]:
    """Trains memories in parallel.

    Returns:
        Folders of their runs, in order.
    """
    code, machine, keyed = code_digest(_train), training_machine(context.where), []
    for job in jobs:
        episodes = [[f"{path.parent.name}/{path.name}" for path in paths] for paths in (job.learn, job.choose)]
        settings = [job.model, asdict(job.size), asdict(replace(job.train, seed=job.seed))]
        key = digest(episodes, settings, code, machine)
        keyed.append((key, (job, context.cache / "memories" / key)))

    def reads(task: tuple[MemoryJob, Path]) -> list[Path]:
        return [*task[0].learn, *task[0].choose, task[1]]

    cached("memories", _train, keyed, context, "training memories", reads=reads, gpus=True)
    return [str(out) for _, (_, out) in keyed]


def _train(task: tuple[MemoryJob, Path]) -> dict[str, Any]:
    from labeling.detectors.registry import choose_device
    from labeling.memory.view_prediction.scenes import read_scenes
    from labeling.memory.view_prediction.training import MemoryTask
    from labeling.training.loop import train

    job, out = task
    title, spec = f"{job.model}, seed {job.seed}", job.size.spec(job.model)
    learn, choose = (read_scenes(paths, spec, job.train.around)[0] for paths in (job.learn, job.choose))
    memory = MemoryTask(spec, learn, choose, replace(job.train, seed=job.seed), choose_device(), {"episodes": title})
    progress = train(memory, out, lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True))
    return {"title": title, "scenes": [len(learn), len(choose)], "history": progress.history}


@dataclass(frozen=True)
class ViewScores:
    """What is to be scored: one method on one set of scenes."""

    method: str
    """Folder of a run, or ``REPROJECTION``."""
    episodes: tuple[Path, ...]
    size: MemorySize
    inputs: tuple[int, ...]
    """Numbers of views that are given."""
    targets: int
    """Views of each scene that are predicted."""


def score_views(jobs: Sequence[ViewScores], context: RunContext) -> list[dict[str, Any]]:
    """Scores predicted views.

    Returns:
        For each job, by the number of inputs, the means of all figures over scenes (``mean``), and a mean for every
        scene (``scenes``).
    """
    code, keyed = code_digest(_score), []
    for job in jobs:
        episodes = [f"{path.parent.name}/{path.name}" for path in job.episodes]
        method = Path(job.method).name  # which is a digest of all that a network was made from
        keyed.append((digest(method, episodes, asdict(job.size), job.inputs, job.targets, code), job))

    def reads(job: ViewScores) -> list[Path]:
        return [*job.episodes, *([] if job.method == REPROJECTION else [Path(job.method)])]

    return cached("view_scores", _score, keyed, context, "scoring predicted views", reads=reads)


def _score(job: ViewScores) -> dict[str, Any]:
    from labeling.detectors.registry import choose_device
    from labeling.memory.networks.weights import load_memory
    from labeling.memory.view_prediction.evaluation import evaluate, score_pictures
    from labeling.memory.view_prediction.reprojection import reproject_views
    from labeling.memory.view_prediction.scenes import read_scenes

    scenes, _ = read_scenes(job.episodes, job.size)
    device = choose_device()
    network = None if job.method == REPROJECTION else load_memory(Path(job.method)).to(device)

    def score(scene: "SmallScene", inputs: int) -> "Scores":
        if network is None:
            return score_pictures(reproject_views, [scene], inputs, job.targets)
        return evaluate(network, [scene], inputs, job.targets, device)

    return _by_inputs(scenes, job.inputs, score)


def _by_inputs(
    scenes: Sequence[_Scene], inputs: Sequence[int], score: "Callable[[_Scene, int], Scores]"
) -> dict[str, Any]:
    """By the number of inputs, means over views for every scene, and of these over the scenes that have them."""
    found = {}
    for count in inputs:
        of_scenes = [
            {name: float(np.mean(values)) for name, values in score(scene, count).items() if values} for scene in scenes
        ]
        names = of_scenes[0]
        mean = {name: float(np.mean([one[name] for one in of_scenes if name in one])) for name in names}
        found[str(count)] = {"mean": mean, "scenes": of_scenes}
    return found


@dataclass(frozen=True)
class ArithmeticScores:
    """What is to be scored: one method on exchanges."""

    method: str
    """Folder of a run of a network that decodes pictures, ``REPROJECTION`` or ``NO_CHANGE``."""
    episodes: Mapping[str, tuple[Path, ...]]
    """By part of the exchange (experiments.cache.object_rooms.PARTS)."""
    size: MemorySize
    inputs: tuple[int, ...]
    """Numbers of views that are given of A, of B and of C."""
    targets: int
    """Views of each answer that are predicted."""


def score_arithmetics(jobs: Sequence[ArithmeticScores], context: RunContext) -> list[dict[str, Any]]:
    """Scores what methods make of A - B + C.

    Returns:
        For each job, by the number of inputs, the means of all figures over exchanges (``mean``), and a mean for every
        exchange (``scenes``).
    """
    code, keyed = code_digest(_score_arithmetic), []
    for job in jobs:
        episodes = [f"{path.parent.parent.name}/{path.name}" for path in job.episodes["answer"]]
        method = Path(job.method).name
        keyed.append((digest(method, episodes, asdict(job.size), job.inputs, job.targets, code), job))

    def reads(job: ArithmeticScores) -> list[Path]:
        learnt = [] if job.method in (REPROJECTION, NO_CHANGE) else [Path(job.method)]
        return [*(path for paths in job.episodes.values() for path in paths), *learnt]

    return cached("arithmetic_scores", _score_arithmetic, keyed, context, "scoring scene arithmetic", reads=reads)


def _score_arithmetic(job: ArithmeticScores) -> dict[str, Any]:
    from labeling.detectors.registry import choose_device
    from labeling.memory.networks.cn3d import Cn3d
    from labeling.memory.networks.weights import load_memory
    from labeling.memory.view_prediction.arithmetic import Exchange, combine_points, combiner, score_arithmetic
    from labeling.memory.view_prediction.scenes import read_scenes

    parts = {part: read_scenes(paths, job.size)[0] for part, paths in job.episodes.items()}
    exchanges = [Exchange(**dict(zip(parts, scenes, strict=True))) for scenes in zip(*parts.values(), strict=True)]
    if job.method == NO_CHANGE:
        combine = None
    elif job.method == REPROJECTION:
        combine = combine_points
    else:
        network = load_memory(Path(job.method)).to(choose_device())
        assert not isinstance(network, Cn3d), "C-N3D decodes features, no pictures"
        combine = combiner(network, choose_device())
    return _by_inputs(exchanges, job.inputs, lambda one, inputs: score_arithmetic(combine, [one], inputs, job.targets))
