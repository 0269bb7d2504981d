"""Stages of experiments: computed once, kept on disk under a digest of all that decides their outcome.

A killed experiment goes on where it was, a changed setting or a changed line of code makes anew what depends on it, and
experiments share what they have in common.
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

from labeling.core.errors import SbmError
from labeling.formats.atomic import write_json
from labeling.runtime.process_pool import run_jobs

Task = TypeVar("Task")
Job = TypeVar("Job")
Scale = Literal["smoke", "quick", "full"]


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
    """Processes at a time."""
    cache: Path
    """Folder for recorded episodes and the outcomes of stages."""


def cached(
    stage: str,
    compute: Callable[[Job], Any],
    jobs: Sequence[tuple[str, Job]],
    context: RunContext,
    title: str,
    always_spawn: bool = False,
) -> list[Any]:
    """What jobs come to, in order; what is not in the cache is computed in parallel and kept.

    Args:
        stage: name of the stage in the cache.
        compute: a function of a module; what it returns is kept as JSON.
        jobs: the key of each, which changes with all that decides its outcome, and what to give ``compute``; picklable.
        context: cache, and how many processes. Each has one thread, which takes two thirds of the time of one job after
            the other in as many threads; with a GPU or a single worker, this process does one after the other.
        title: of the progress bar.
        always_spawn: processes of one thread each in any case, where jobs measure time.

    Raises:
        SbmError: once all other jobs are done, if any has failed.
    """
    from labeling.detectors.registry import choose_device

    paths = {key: context.cache / "stages" / stage / key[:2] / f"{key}.json" for key, _ in jobs}
    missing = [(paths[key], job) for key, job in dict(jobs).items() if not paths[key].is_file()]
    work = partial(_compute, compute)
    if always_spawn or (context.workers > 1 and choose_device() == "cpu"):
        run_tasks(work, missing, context.workers, title)
    else:
        for job in tqdm(missing, desc=title, unit="run", file=sys.stderr):
            work(job)
    return [_read_outcome(paths[key]) for key, _ in jobs]


def _read_outcome(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SbmError(f"{path}: cannot be read ({error}); delete it to have it made again") from None


def _compute(compute: Callable[[Job], Any], item: tuple[Path, Job]) -> None:
    path, job = item
    write_json(path, compute(job))


def run_tasks(work: Callable[[Task], object], tasks: Sequence[Task], workers: int, title: str) -> None:
    """Works through tasks in processes of one thread each, with a progress bar.

    Args:
        work: a function of a module, which keeps its outcome itself.
        tasks: what to give it; picklable.
        workers: how many processes.
        title: of the progress bar.

    Raises:
        SbmError: once all other tasks are done, if any has failed.
    """
    errors: list[str] = []
    bar = tqdm(total=len(tasks), desc=title, unit="run", smoothing=0.05, file=sys.stderr)
    # One thread each, for a single worker, too: what time things take does not depend on how many there are.
    with bar, closing(run_jobs(work, tasks, workers, always_spawn=True)) as outcomes:
        for outcome in outcomes:
            if isinstance(outcome.error, SbmError):
                errors.append(str(outcome.error))
                tqdm.write(f"error: {outcome.error}", file=sys.stderr)
            else:
                outcome.result()
            bar.update()
    if errors:
        raise SbmError(f"{len(errors)} of {len(tasks)} tasks failed; the first: {errors[0]}")
