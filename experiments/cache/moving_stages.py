"""Stages of experiments with flow on memories: train it, score what is found to move. Outcomes are kept."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.cache.origin import training_machine
from experiments.cache.stages import RunContext, cached, digest
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.memory.settings.memory_spec import MemorySize
from labeling.runtime.code_digest import code_digest

if TYPE_CHECKING:
    from labeling.memory.flow.flow_evaluation import MovingTruth
    from labeling.memory.flow.moving_objects import MovingObject
    from labeling.memory.view_prediction.scenes import SmallScene
    from labeling.metrics.box_ap import BoxInstance

RESIDUALS, CLUSTERS = "ICP residuals", "ICP of clusters"
"""Methods without learning: see ``experiments.cache.icp_residuals``."""
SPEEDS_M = (0.05, 0.15, 0.25, 10.0)
"""Edges of bins of how far objects move between two views."""
FOUND_IOU = 0.25
"""From which on an object counts as found in recall."""


@dataclass(frozen=True)
class FlowJob:
    """A training of flow on a memory."""

    memory: str
    """Folder of a run."""
    learn: tuple[Path, ...]
    """Episodes in which nothing moves; or, supervised, in which things move as ground truth tells."""
    moving: tuple[Path, ...]
    """Episodes in which things move, whose motion is not known; may be empty."""
    choose: tuple[Path, ...]
    """As ``learn``; the network that does best on them is kept."""
    train: TrainFlowConfig
    """Its seed is replaced."""
    seed: int
    title: str
    supervised: bool = False
    """Whether true motion in ``learn`` and ``choose`` is learnt from."""


def train_flows(jobs: Sequence[FlowJob], context: RunContext) -> list[str]:
    """Trains flow in parallel.

    Returns:
        Folders of the runs, in order.
    """
    code, machine, keyed = code_digest(_train), training_machine(context.where), []
    for job in jobs:
        episodes = [[_name(path) for path in paths] for paths in (job.learn, job.moving, job.choose)]
        settings = asdict(replace(job.train, seed=job.seed)), job.supervised
        key = digest(episodes, Path(job.memory).name, *settings, code, machine)
        keyed.append((key, (job, context.cache / "flows" / key)))

    def reads(task: tuple[FlowJob, Path]) -> list[Path]:
        job, out = task
        return [*job.learn, *job.moving, *job.choose, Path(job.memory), out]

    cached("flows", _train, keyed, context, "training flow", reads=reads, gpus=True)
    return [str(out) for _, (_, out) in keyed]


def _name(episode: Path) -> str:
    return f"{episode.parent.name}/{episode.name}"


def _train(task: tuple[FlowJob, Path]) -> dict[str, Any]:
    from labeling.detectors.registry import choose_device
    from labeling.memory.flow.flow_training import FlowTask
    from labeling.memory.flow.true_pairs import read_true_pairs
    from labeling.memory.flow.view_pairs import read_view_pairs
    from labeling.memory.networks.weights import load_memory
    from labeling.training.loop import train

    job, out = task
    title, memory = f"{job.title}, seed {job.seed}", load_memory(Path(job.memory))
    read = read_true_pairs if job.supervised else read_view_pairs
    learn, choose = (read(paths, memory.spec)[0] if paths else [] for paths in (job.learn, job.choose))
    moving = read_view_pairs(job.moving, memory.spec)[0] if job.moving else []
    config = replace(job.train, seed=job.seed)
    flow = FlowTask(memory, learn, moving, choose, config, choose_device(), {"episodes": title})
    progress = train(flow, out, lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True))
    return {"title": title, "pairs": [sum(map(len, part)) for part in (learn, moving, choose)]} | {
        "history": progress.history
    }


@dataclass(frozen=True)
class MovingScores:
    """What is to be scored: one method on the pairs of views of some episodes."""

    method: str
    """Folder of a run, or one of ``RESIDUALS`` and ``CLUSTERS``."""
    episodes: tuple[Path, ...]
    """With ground truth."""
    size: MemorySize
    """Of the grid in which things are to be found."""


def score_moving(jobs: Sequence[MovingScores], context: RunContext) -> list[dict[str, Any]]:
    """Scores what methods find to move, without regard to what it is.

    Returns:
        For each job ``ap25``, ``ap50`` of boxes and ``bev25``, ``bev50`` of their footprints; ``boxes``, ``pairs`` and
        ``objects``, how many there are; ``recall``, by how far objects move, how many there are and which share any
        box finds; of networks ``moving_m`` and ``standing_m``, mean errors of flow of voxels, and ``zero_m``, what
        these are where things move if nothing is said to.
    """
    code, keyed = code_digest(_score), []
    for job in jobs:
        settings = [Path(job.method).name, asdict(job.size)]
        keyed.append((digest([_name(path) for path in job.episodes], settings, code), job))

    def reads(job: MovingScores) -> list[Path]:
        return [*job.episodes, *([] if job.method in (RESIDUALS, CLUSTERS) else [Path(job.method)])]

    return cached("moving_scores", _score, keyed, context, "scoring what moves", reads=reads, gpus=True)


def _score(job: MovingScores) -> dict[str, Any]:
    from labeling.core.errors import EpisodeFormatError
    from labeling.io.episodes import read_episode
    from labeling.memory.flow.flow_detector import load_moving_detector
    from labeling.memory.flow.flow_evaluation import endpoint_errors, mean_or_zero, moving_truths, true_flow
    from labeling.memory.flow.moving_objects import MOVING
    from labeling.memory.flow.view_pairs import view_pairs
    from labeling.metrics.box_ap import BoxInstance

    grid = job.size.grid
    network = None if job.method in (RESIDUALS, CLUSTERS) else load_moving_detector(Path(job.method))
    baseline = _baseline(job)
    found: list[BoxInstance] = []
    truths: list[tuple[BoxInstance, MovingTruth]] = []
    errors: tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]] = ([], [], [])
    pairs = 0
    for folder in job.episodes:
        episode = read_episode(folder)
        try:
            of_episode = view_pairs(episode.name, episode, job.size)
        except EpisodeFormatError:  # nothing can be seen to move, by any method
            continue
        for pair in of_episode:
            image = f"{episode.name}/{pair.view_index[0]}"
            if network is None:
                objects = baseline(pair)
            else:
                output, before = network.flow(pair)
                objects = network.objects(pair, output, before)
                if episode.motion is not None:
                    truth, flow_m = true_flow(episode, pair, grid), output.flow_m.cpu()
                    moving, standing = endpoint_errors(flow_m, truth, before.occupied.cpu())
                    still, _ = endpoint_errors(0 * flow_m, truth, before.occupied.cpu())
                    for kept, new in zip(errors, (moving, standing, still), strict=True):
                        kept.append(new)
            found += [BoxInstance(image, MOVING, one.box, one.confidence) for one in objects]
            for one in moving_truths(episode, pair, grid):
                truths.append((BoxInstance(image, MOVING, one.box, ignore=one.ignore), one))
        pairs += len(of_episode)
    figures = {"pairs": pairs, "boxes": len(found), "objects": sum(not one.ignore for _, one in truths)}
    figures |= {"recall": _recall(found, truths), **_precision(found, [one for one, _ in truths])}
    if network is not None:
        names = ("moving_m", "standing_m", "zero_m")
        figures |= {name: mean_or_zero(values) for name, values in zip(names, errors, strict=True)}
    return figures


def _baseline(job: MovingScores) -> "Callable[[SmallScene], list[MovingObject]]":
    from experiments.cache.icp_residuals import IcpSettings, icp_residuals

    settings = IcpSettings(whole_clusters=job.method == CLUSTERS)
    return lambda pair: icp_residuals(pair, job.size.grid, settings)


def _precision(found: "Sequence[BoxInstance]", truths: "Sequence[BoxInstance]") -> dict[str, float | None]:
    from labeling.metrics.box_ap import average_precision_3d

    solid = average_precision_3d(found, truths).mean
    flat = average_precision_3d(found, truths, kind="bev").mean
    return {"ap25": solid[0.25], "ap50": solid[0.5], "bev25": flat[0.25], "bev50": flat[0.5]}


def _recall(
    found: "Sequence[BoxInstance]", truths: "Sequence[tuple[BoxInstance, MovingTruth]]"
) -> list[dict[str, float | None]]:
    """By how far objects move, from slow to fast."""
    from itertools import pairwise

    from labeling.core.box_overlap import box_iou_3d

    rows: list[dict[str, float | None]] = []
    for low, high in pairwise(SPEEDS_M):
        wanted = [one for one, truth in truths if not truth.ignore and low <= truth.moved_m < high]
        hits = [
            any(box_iou_3d(one.box, other.box) >= FOUND_IOU for other in found if other.image == one.image)
            for one in wanted
        ]
        rows.append({"from_m": low, "objects": len(wanted), "recall": float(np.mean(hits)) if hits else None})
    return rows
