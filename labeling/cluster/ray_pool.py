"""Jobs done by processes on the nodes of a Ray cluster.

The machine that gives the jobs places one process (a Ray actor) on each core of each node, and gives it one job after
the other: so it knows which job a lost process had, gives that to another, and never has more on the way than there are
processes. Nodes may come and go meanwhile.
"""

import contextlib
import secrets
import sys
from collections.abc import Generator, Iterable, Iterator, Sized
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.cluster.cluster_config import ClusterConfig, JobFiles, SameThere
from labeling.cluster.ray_connection import connect
from labeling.cluster.ray_schedule import Schedule
from labeling.cluster.ray_worker import Orders
from labeling.cluster.same_code import contents_here, packages_up_to
from labeling.cluster.travel import absolute, dumps
from labeling.core.errors import UsageError
from labeling.runtime.process_pool import Outcome, PerProcess, Work
from labeling.runtime.provenance import git_commit


@dataclass(frozen=True)
class RayPool:
    """A way to do jobs: on a cluster."""

    where: ClusterConfig
    workers: int = 0
    """At most so many processes of all nodes together; 0: one for each core."""
    files: JobFiles | None = None
    """That jobs read and write."""
    more: tuple[SameThere, ...] = ()
    """What must be the same on all nodes, besides code, libraries and weights."""
    gpus: bool = False
    """Whether jobs use a GPU, on nodes that have some."""

    def run(self, work: Work[Any, Any], jobs: Iterable[Any], ordered: bool = False) -> Generator[Outcome, None, None]:
        """Does jobs; as ``labeling.runtime.process_pool.run_jobs``, but a job whose process is lost is done again.

        Raises:
            SbmError: if there is no such cluster, or none of its nodes can be used.
        """
        workers = self.workers or sys.maxsize
        if isinstance(jobs, Sized):
            workers = min(workers, len(jobs))
        if workers < 1:
            return
        connect(self.where.cluster)
        with contextlib.ExitStack() as stack:
            orders = stack.enter_context(_orders(self, work))
            run = Schedule(self.files, self.where.shared is not None, self.gpus, orders, workers)
            stack.callback(run.stop)
            yield from _in_order(run, jobs) if ordered else run.outcomes(jobs, lambda: True)


@contextlib.contextmanager
def _orders(pool: RayPool, work: Work[Any, Any]) -> Iterator[Orders]:
    """What processes are told first.

    Raises:
        UsageError: if something cannot be sent, or does not lie on the shared disk.
    """
    shared, files, folder = pool.where.shared, pool.files, str(Path.cwd())
    packages = packages_up_to(_module_of(work))
    with contextlib.ExitStack() as stack:
        marker = None
        if shared is not None:
            for path in (Path(folder), *((files.out, *files.common) if files else ())):
                if not Path(absolute(path)).is_relative_to(absolute(shared)):
                    raise UsageError(f"--shared {shared}: {path} does not lie below it, so that nodes cannot see it")
            marker = Path(absolute(shared)) / f".sbm-shared-{secrets.token_hex(8)}"
            marker.touch()
            stack.callback(marker.unlink, missing_ok=True)
        yield Orders(
            dumps(work),
            folder,
            packages,
            pool.more,
            contents_here(packages, pool.more),
            absolute(files.out) if files and shared is None else None,
            files.last if files else (),
            git_commit() or "",
            None if marker is None else str(marker),
        )


def _module_of(work: Any) -> str:
    """The module of the function that does the work, or of the object that it is a method of."""
    while True:
        if isinstance(work, PerProcess):
            work = work.make
        elif hasattr(work, "func"):  # of functools.partial
            work = work.func
        else:
            break
    owner = getattr(work, "__self__", None)
    module = type(owner).__module__ if owner is not None else getattr(work, "__module__", type(work).__module__)
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return spec.name if module == "__main__" and spec is not None else module or ""


def _in_order(run: Schedule, jobs: Iterable[Any]) -> Iterator[Outcome]:
    """Outcomes in the order of jobs; if many are done before one that comes first, no more are begun."""
    early: dict[int, Outcome] = {}
    due = 0
    for outcome in run.outcomes(jobs, lambda: len(early) < 4 * max(len(run.processes), 1)):
        early[outcome.number] = outcome
        while due in early:
            yield early.pop(due)
            due += 1
