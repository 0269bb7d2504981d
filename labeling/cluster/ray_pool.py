"""Jobs done by processes on the nodes of a Ray cluster.

The machine that gives the jobs places one process (a Ray actor) on each core of each node, and gives it one job after
the other: so it knows which job a lost process had, gives that to another, and never has more on the way than there are
processes. Nodes may come and go meanwhile.
"""

import contextlib
import sys
from collections.abc import Generator, Iterable, Iterator, Sized
from dataclasses import dataclass
from typing import Any

from labeling.cluster.cluster_config import ClusterConfig, JobFiles, SameThere
from labeling.cluster.ray_connection import connect
from labeling.cluster.ray_orders import module_of, orders_for
from labeling.cluster.ray_schedule import Schedule
from labeling.runtime.process_pool import Outcome, Work


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
            orders = stack.enter_context(orders_for(work, module_of(work), self.where, self.more, self.files))
            run = Schedule(self.files, self.where.shared is not None, self.gpus, orders, workers)
            stack.callback(run.stop)
            yield from _in_order(run, jobs) if ordered else run.outcomes(jobs, lambda: True)


def _in_order(run: Schedule, jobs: Iterable[Any]) -> Iterator[Outcome]:
    """Outcomes in the order of jobs; if many are done before one that comes first, no more are begun."""
    early: dict[int, Outcome] = {}
    due = 0
    for outcome in run.outcomes(jobs, lambda: len(early) < 4 * max(len(run.processes), 1)):
        early[outcome.number] = outcome
        while due in early:
            yield early.pop(due)
            due += 1
