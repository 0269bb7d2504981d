"""What each stage of labelling costs, and what the machine would need at least for it."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import labeling.generator.segment.mean_field
import labeling.generator.segment.permutohedral_lattice
import labeling.generator.segment.svm
from experiments.benchmarks.rows import Row
from labeling.io.episodes import read_episode

STAGES = {
    "read pictures and masks": "labeling.io.episodes.read_episode",
    "voxels (two clouds, one beside the rest)": "labeling.generator.propagate.build_cloud",
    "seeds and objects": "labeling.generator.propagate._associate",
    "SVM: train, decide": "labeling.generator.segment.crf.object_log_odds",
    "CRF: lattices": "labeling.generator.segment.crf.crf_kernels",
    "CRF: mean field": "labeling.generator.segment.active_points.mean_field",
    "connected components and boxes": "labeling.generator.propagate._describe_objects",
    "masks of all views": "labeling.generator.propagate.draw_labels",
    "run-length codes": "labeling.generator.label_jobs.episode_record",
    "cloud file": "labeling.io.formats.ply.write_ply",
}
"""Functions that are timed, by stage. Stages on several threads may overlap."""
SVM_FLOPS_PER_VALUE = 3 * 6 + 19
"""Squared distance in six dimensions, and an exponential."""


class Floors:
    """Bytes moved and operations done in one run, counted from the sizes of what goes in and out."""

    def __init__(self) -> None:
        self.megabytes = dict.fromkeys(STAGES, 0.0)
        self.operations = dict.fromkeys(STAGES, 0.0)

    def decide(self, original: Callable) -> Callable:
        """Counts the kernel values of an SVM."""

        def counted(features, support, *others):
            self.operations["SVM: train, decide"] += float(len(features)) * len(support) * SVM_FLOPS_PER_VALUE
            return original(features, support, *others)

        return counted

    def filter(self, original: Callable) -> Callable:
        """Counts what filtering on a lattice reads and writes: corners and weights twice, neighbours once."""

        def counted(lattice, values):
            corners = lattice.vertex.shape[1]
            points, vertices = lattice.num_points * corners * 8 * 2, lattice.num_vertices * corners * (8 + 8)
            self.megabytes["CRF: mean field"] += values.shape[1] * (points + vertices) / 1e6
            return original(lattice, values)

        return counted


def stage_rows(label: Callable[[Path], float], folder: Path, repeats: int) -> Iterator[Row]:
    """Seconds of each stage beside its floor: what moving its data, or its arithmetic, takes at least.

    Args:
        label: labels the episode into a folder.
        folder: the episode; the output goes beside it.
        repeats: how often; the least seconds of each stage count.
    """
    out = folder.parent / "stages"
    seconds = dict.fromkeys(STAGES, np.inf)
    total = np.inf
    for _ in range(repeats):
        spent = dict.fromkeys(STAGES, 0.0)
        with ExitStack() as patches:
            for stage, target in STAGES.items():
                patches.enter_context(mock.patch(target, timed_stage(_find(target), spent, stage)))
            total = min(total, label(out))
        seconds = {stage: min(seconds[stage], spent[stage]) for stage in STAGES}
    floors = _count(label, folder, out)
    bandwidth, flops = _bandwidth_mb_s(), _flops_s()
    for stage, best in seconds.items():
        moved, done = floors.megabytes[stage], floors.operations[stage]
        floor = max(moved / bandwidth, done / flops)
        what = f"{done / 1e9:.2f} Gflop" if done / flops > moved / bandwidth else f"{moved:.0f} MB"
        yield Row(f"stage: {stage}", f"floor: {what}", best, floor, note=f"{best / total:.0%} of {total:.2f} s")


def _count(label: Callable[[Path], float], folder: Path, out: Path) -> Floors:
    """The floors of one episode."""
    floors = Floors()
    kept: list[Any] = []
    with ExitStack() as patches:
        patches.enter_context(
            mock.patch.object(
                labeling.generator.segment.svm, "_decide", floors.decide(labeling.generator.segment.svm._decide)
            )
        )
        lattice = labeling.generator.segment.permutohedral_lattice.Lattice
        patches.enter_context(mock.patch.object(lattice, "filter", floors.filter(lattice.filter)))
        propagate = _find("labeling.generator.propagate.propagate")
        patches.enter_context(
            mock.patch(
                "labeling.generator.propagate.propagate", lambda *given: kept.append(propagate(*given)) or kept[-1]
            )
        )
        label(out)
    episode, labels = read_episode(folder, ground_truth=False), kept[-1]
    pixels, masks = episode.depth_m.size, len(episode.detections or ())
    size = episode.size[0] * episode.size[1]
    points, rows = len(labels.cloud.points), labels.cloud.probability
    near = int(np.count_nonzero(rows))
    megabytes = {
        "read pictures and masks": _bytes(folder) + pixels * 7 + masks * size,
        "voxels (two clouds, one beside the rest)": 2 * (pixels * (7 + 4) + points * 28),
        "seeds and objects": masks * size * (1 + 4),
        "CRF: lattices": near * (7 + 4) * 8 * 2,
        "connected components and boxes": points * 16 + rows.nbytes,
        "masks of all views": pixels * (3 + 4) + 2 * len(labels.labels) * size,
        "run-length codes": 2 * len(labels.labels) * size,
        "cloud file": 2 * _bytes(out / "clouds"),
    }
    for stage, count in megabytes.items():
        floors.megabytes[stage] += count / 1e6
    return floors


def _find(target: str) -> Any:
    import importlib

    module, _, name = target.rpartition(".")
    return getattr(importlib.import_module(module), name)


def timed_stage(function: Callable, spent: dict[str, float], stage: str) -> Callable:
    """The function, whose seconds are added to ``spent[stage]``."""

    def timed(*given, **named):
        started = time.perf_counter()
        try:
            return function(*given, **named)
        finally:
            spent[stage] += time.perf_counter() - started

    return timed


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _bandwidth_mb_s() -> float:
    """What one thread copies, read and written bytes counted."""
    source = np.ones(32_000_000, np.float32)
    target = np.empty_like(source)
    return 2 * source.nbytes / 1e6 / _least(lambda: np.copyto(target, source))


def _flops_s() -> float:
    """Single-precision arithmetic of a large matrix product on all threads."""
    a = np.ones((1024, 1024), np.float32)
    return 2 * 1024**3 / _least(lambda: a @ a)


def _least(work: Callable[[], object]) -> float:
    work()
    seconds = []
    for _ in range(7):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return min(seconds)
