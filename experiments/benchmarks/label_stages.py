"""Time of each stage of labelling, and a lower bound on it from the machine's bandwidth and arithmetic."""

import timeit
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from pkgutil import resolve_name
from typing import Any
from unittest import mock

import numpy as np

from experiments.benchmarks.rows import Row, timed
from labeling.generator.segment import svm
from labeling.generator.segment.permutohedral_lattice import Lattice
from labeling.io.episodes import read_episode

STAGES = {
    "read pictures and masks": "labeling.io.episodes.read_episode",
    "voxels": "labeling.generator.propagate.build_cloud",
    "check of poses": "labeling.generator.propagate.with_agreeing_poses",
    "seeds": "labeling.generator.propagate.trimap_seeds",
    "objects and their chances": "labeling.generator.propagate.find_objects",
    "SVM: train, decide": "labeling.generator.segment.crf.object_log_odds",
    "CRF: lattices": "labeling.generator.segment.crf.crf_kernels",
    "CRF: mean field": "labeling.generator.segment.active_points.mean_field",
    "ground": "labeling.generator.propagate.find_ground",
    "connected components": "labeling.generator.propagate.segment_outliers",
    "level surfaces": "labeling.generator.propagate.complete_level_surfaces",
    "boards at the ends": "labeling.generator.propagate.complete_end_boards",
    "thin parts": "labeling.generator.propagate.find_thin_parts",
    "fine points of objects": "labeling.generator.draw.fused_views.fine_points",
    "masks of all views": "labeling.generator.propagate.draw_labels",
    "run-length codes": "labeling.generator.label_jobs.episode_record",
    "cloud file": "labeling.formats.ply.write_ply",
}
"""Functions that are timed, by stage. Stages on several threads may overlap."""
PROPAGATE = "labeling.generator.propagate.propagate"
SVM_FLOPS_PER_VALUE = 3 * 6 + 19
"""Squared distance in six dimensions, and an exponential."""


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
                patches.enter_context(mock.patch(target, timed(resolve_name(target), spent, stage)))
            total = min(total, label(out))
        seconds = {stage: min(seconds[stage], spent[stage]) for stage in STAGES}
    megabytes, operations = _floors(label, folder, out)
    bandwidth, flops = _bandwidth_mb_s(), _flops_s()
    for stage, best in seconds.items():
        moved, done = megabytes[stage], operations[stage]
        floor = max(moved / bandwidth, done / flops)
        what = f"{done / 1e9:.2f} Gflop" if done / flops > moved / bandwidth else f"{moved:.0f} MB"
        yield Row(f"stage: {stage}", f"floor: {what}", best, floor, note=f"{best / total:.0%} of {total:.2f} s")


def _floors(label: Callable[[Path], float], folder: Path, out: Path) -> tuple[dict[str, float], dict[str, float]]:
    """Megabytes moved and operations done by each stage, counted from the sizes of what goes in and out."""
    operations, moved = dict.fromkeys(STAGES, 0.0), dict.fromkeys(STAGES, 0.0)
    decide, filtered, propagate = svm._decide, Lattice.filter, resolve_name(PROPAGATE)
    kept: list[Any] = []

    def count_kernel_values(features, support, *others):
        operations["SVM: train, decide"] += float(len(features)) * len(support) * SVM_FLOPS_PER_VALUE
        return decide(features, support, *others)

    def count_bytes(lattice, values):
        """Corners and weights are read and written twice, neighbours once."""
        corners = lattice.vertex.shape[1]
        points, vertices = lattice.num_points * corners * 8 * 2, lattice.num_vertices * corners * (8 + 8)
        moved["CRF: mean field"] += values.shape[1] * (points + vertices)
        return filtered(lattice, values)

    def keep_labels(*given):
        kept.append(propagate(*given))
        return kept[-1]

    with (
        mock.patch.object(svm, "_decide", count_kernel_values),
        mock.patch.object(Lattice, "filter", count_bytes),
        mock.patch(PROPAGATE, keep_labels),
    ):
        label(out)
    episode, labels = read_episode(folder, ground_truth=False), kept[-1]
    pixels, masks = episode.depth_m.size, len(episode.detections or ())
    size = episode.size[0] * episode.size[1]
    points, rows = len(labels.cloud.points), labels.cloud.probability
    near = int(np.count_nonzero(rows))
    moved |= {
        "read pictures and masks": _bytes(folder) + pixels * 7 + masks * size,
        "voxels": pixels * (7 + 4) + points * 28,
        "check of poses": pixels * 4,
        "seeds": masks * size * (1 + 4),
        "objects and their chances": points * 4,
        "CRF: lattices": near * (7 + 4) * 8 * 2,
        "connected components": points * 16 + rows.nbytes,
        "ground": pixels * 4 + points * 16,
        "level surfaces": points * 16,
        "boards at the ends": points * 16,
        "thin parts": points * 16,
        "fine points of objects": pixels * (4 + 4),
        "masks of all views": pixels * (3 + 4) + 2 * len(labels.labels) * size,
        "run-length codes": 2 * len(labels.labels) * size,
        "cloud file": 2 * _bytes(out / "clouds"),
    }
    return {stage: count / 1e6 for stage, count in moved.items()}, operations


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _bandwidth_mb_s() -> float:
    """What one thread copies, read and written bytes counted."""
    source = np.ones(32_000_000, np.float32)
    target = np.empty_like(source)
    return 2 * source.nbytes / 1e6 / min(timeit.repeat(lambda: np.copyto(target, source), number=1, repeat=8))


def _flops_s() -> float:
    """Single-precision arithmetic of a large matrix product on all threads."""
    a = np.ones((1024, 1024), np.float32)
    return 2 * 1024**3 / min(timeit.repeat(lambda: a @ a, number=1, repeat=8))
