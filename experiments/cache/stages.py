"""Stages of experiments: computed once, kept on disk under a digest of all that decides their outcome.

A killed experiment goes on where it was, a changed setting or a changed line of code makes anew what depends on it, and
experiments share what they have in common. Outcomes are kept on the disk of the machine that the experiment was started
on, also where nodes of a cluster compute them.
"""

import hashlib
import json
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from tqdm import tqdm

from labeling.cluster.cluster_config import HERE, ClusterConfig, JobFiles, nothing
from labeling.cluster.jobs import run_jobs
from labeling.core.errors import SbmError
from labeling.formats.atomic import write_json

Task = TypeVar("Task")
Job = TypeVar("Job")
Scale = Literal["smoke", "quick", "standard", "full"]


def digest(*parts: Any) -> str:
    """A short name for JSON content, the same for the same content."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, allow_nan=False).encode()).hexdigest()[:24]


def folder_digest(folder: Path) -> str:
    """Changes whenever a file in the folder does."""
    found = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        found.update(path.relative_to(folder).as_posix().encode() + b"\0")
        found.update(hashlib.sha256(path.read_bytes()).digest())
    return found.hexdigest()


@dataclass(frozen=True)
class RunContext:
    """What an experiment is run with."""

    scale: Scale
    seeds: tuple[int, ...]
    workers: int
    """Processes at a time; on a cluster at most, with 1 one for each core."""
    cache: Path
    """Folder for recorded episodes and the outcomes of stages."""
    where: ClusterConfig = HERE
    """This machine or a cluster."""
    rounds: int | None = None
    """Of loops; None takes as many as the scale says."""


def cached(
    stage: str,
    compute: Callable[[Job], Any],
    jobs: Sequence[tuple[str, Job]],
    context: RunContext,
    title: str,
    always_spawn: bool = False,
    reads: Callable[[Job], Sequence[Path]] = nothing,
    gpus: bool = False,
) -> list[Any]:
    """What jobs come to, in order; what is not in the cache is computed in parallel and kept.

    Args:
        stage: name of the stage in the cache.
        compute: a function of a module; what it returns is kept as JSON. Files go into the cache, too.
        jobs: the key of each, which changes with all that decides its outcome, and what to give ``compute``; picklable.
        context: cache, how many processes, and where. Each has one thread, which takes two thirds of the time of one
            job after the other in as many threads; with a GPU or a single worker of this machine, this process does one
            after the other.
        title: of the progress bar.
        always_spawn: processes of one thread each in any case, where jobs measure time.
        reads: files and folders that a job reads, to travel to the nodes of a cluster; what is not there is passed
            over.
        gpus: whether jobs use a GPU, on nodes that have some.

    Raises:
        Exception: once all other jobs are done, if any has failed; see ``run_tasks``.
    """
    from labeling.detectors.registry import choose_device

    paths = {key: context.cache / "stages" / stage / key[:2] / f"{key}.json" for key, _ in jobs}
    missing = [(paths[key], job) for key, job in dict(jobs).items() if not paths[key].is_file()]
    spawn = always_spawn or (context.workers > 1 and choose_device() == "cpu")
    workers = context.workers if spawn or not context.where.is_local else 1
    files = None if context.where.is_local else _travelling(context.cache, missing, reads)
    work = partial(_compute, compute)
    run_tasks(work, missing, workers, title, spawn=spawn, where=context.where, files=files, gpus=gpus)
    return [_read_outcome(paths[key]) for key, _ in jobs]


def _travelling(cache: Path, missing: Sequence[tuple[Path, Job]], reads: Callable[[Job], Sequence[Path]]) -> JobFiles:
    """Files that jobs read and write; what several of them read, all of them, travels once to each process."""
    of_each = [set(reads(job)) for _, job in missing]
    common = set.intersection(*of_each) if len(of_each) > 1 else set()
    return JobFiles(cache, lambda item: [path for path in reads(item[1]) if path not in common], sorted(common))


def _read_outcome(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SbmError(f"{path}: cannot be read ({error}); delete it to have it made again") from None


def _compute(compute: Callable[[Job], Any], item: tuple[Path, Job]) -> None:
    path, job = item
    write_json(path, compute(job))


def run_tasks(
    work: Callable[[Task], object],
    tasks: Sequence[Task],
    workers: int,
    title: str,
    *,
    spawn: bool = True,
    where: ClusterConfig = HERE,
    files: JobFiles | None = None,
    gpus: bool = False,
) -> None:
    """Works through tasks side by side, with a progress bar; one that fails does not keep others from being done.

    Args:
        work: a function of a module, which keeps its outcome itself.
        tasks: what to give it; picklable.
        workers: how many processes.
        title: of the progress bar.
        spawn: processes of one thread each, for a single worker, too: what time things take does not depend on how many
            there are. Otherwise a single worker is this process.
        where: this machine or a cluster.
        files: what tasks read and write.
        gpus: whether tasks use a GPU, on nodes that have some.

    Raises:
        Exception: once all other tasks are done, the first that is no ``SbmError``, if a task has raised one.
        SbmError: likewise if any has failed otherwise, or its process was lost three times; the first is named.
    """
    errors: list[Exception] = []
    bar = tqdm(total=len(tasks), desc=title, unit="run", smoothing=0.05, file=sys.stderr)
    outcomes = run_jobs(work, tasks, workers, where=where, files=files, gpus=gpus, always_spawn=spawn)
    with bar, closing(outcomes):
        for outcome in outcomes:
            if outcome.error is not None:
                errors.append(outcome.error)
                tqdm.write(f"error: {str(outcome.error) or type(outcome.error).__name__}", file=sys.stderr)
            bar.update()
    for error in errors:
        if not isinstance(error, SbmError):
            raise error
    if errors:
        raise SbmError(f"{len(errors)} of {len(tasks)} tasks failed; the first: {errors[0]}")
