"""Which process on which node does which job, and what becomes of jobs whose process is lost."""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from labeling.cluster.cluster_config import JobFiles
from labeling.cluster.ray_connection import tell
from labeling.cluster.ray_processes import LOOK_S, MAX_ATTEMPTS, Process, Processes, first_line
from labeling.cluster.ray_worker import Orders
from labeling.cluster.travel import bring_home, dumps, loads, num_bytes, pack
from labeling.core.errors import SbmError
from labeling.runtime.process_pool import Outcome, WorkerDiedError

STORE_SHARE = 0.5
"""Of an object store, that inputs on the way may take."""


@dataclass
class _Given:
    """A job on its way."""

    number: int
    job: Any
    pickled: bytes = b""
    files: Any = None
    """Reference to its packed files."""
    bytes: int = 0
    losses: list[str] = field(default_factory=list)
    """How each process ended that it was given to."""


class Schedule:
    """Jobs in the hands of a cluster."""

    def __init__(self, files: JobFiles | None, is_shared: bool, gpus: bool, orders: Orders, limit: int) -> None:
        """Sees which nodes there are; processes are started when jobs are asked for.

        Args:
            files: that jobs read and write.
            is_shared: whether they lie on a disk that all nodes share, so that they do not travel.
            gpus: whether jobs use a GPU, on nodes that have some.
            orders: what processes are told first.
            limit: at most so many processes.

        Raises:
            SbmError: if what all jobs read does not fit into the object stores.
        """
        import ray

        self._ray, self._files, self._is_shared = ray, files, is_shared
        self._crew = Processes(orders, limit, gpus, files.common if files and not is_shared else ())
        self._again: deque[_Given] = deque()
        self._here = ray.get_runtime_context().get_node_id()

    @property
    def processes(self) -> list[Process]:
        """Those that do the jobs."""
        return self._crew.all

    def outcomes(self, jobs: Iterable[Any], may_begin: Callable[[], bool]) -> Generator[Outcome, None, None]:
        """How it went with each job, as they come."""
        waiting = enumerate(jobs)
        held: _Given | Outcome | None = None
        ended = False
        while True:
            self._crew.look()
            # A job is taken only when there is a process for it: there may be no end of them.
            while process := self._free():
                if held is None:
                    if self._again:
                        held = self._again.popleft()
                    elif may_begin():
                        held = self._next(waiting)
                        ended = held is None
                if isinstance(held, Outcome):
                    yield held
                    held = None
                    continue
                if held is None or not self._fits(held, process):
                    break
                self._give(process, held)
                held = None
            if ended and held is None and not self._again and not any(process.given for process in self.processes):
                return
            yield from self._wait()

    def stop(self) -> None:
        """Ends all processes."""
        self._crew.stop()

    def _next(self, waiting: Iterator[tuple[int, Any]]) -> _Given | Outcome | None:
        """The next job, with its files packed; what came of it, if it cannot be sent; None if there is none."""
        for number, job in waiting:
            given = _Given(number, job)
            try:
                given.pickled = dumps(job)
                self._pack(given)
            except Exception as error:  # for the caller to judge
                return Outcome(number, job, None, error)
            return given
        return None

    def _pack(self, given: _Given) -> None:
        """Puts the files of a job into the object store.

        Raises:
            OSError: if one cannot be read.
            SbmError: if they do not fit.
        """
        files = self._files
        if files is None or self._is_shared:
            return
        paths = files.reads(given.job)
        if not paths:
            return
        given.bytes = num_bytes(paths)
        if problem := self._crew.too_large(given.bytes, ", ".join(str(path) for path in paths[:1])):
            raise SbmError(problem)
        given.files = self._crew.put(pack(paths))

    def _fits(self, given: _Given, process: Process) -> bool:
        """Whether the inputs on the way leave room for those of one more job."""
        for node, others in ((self._here, self.processes), (process.node, self._crew.on(process.node))):
            on_the_way = sum(other.given.bytes for other in others if other.given)
            limit = STORE_SHARE * self._crew.nodes[node].store_bytes if node in self._crew.nodes else float("inf")
            if on_the_way and on_the_way + given.bytes > limit:
                return False
        return True

    def _free(self) -> Process | None:
        return next((process for process in self.processes if process.ready and process.given is None), None)

    def _give(self, process: Process, given: _Given) -> None:
        process.given = given
        process.waits_for = process.actor.do.remote(given.pickled, given.files)

    def _wait(self) -> Iterator[Outcome]:
        """Waits a while for something to be over."""
        waits_for = {process.waits_for: process for process in self.processes if process.given or not process.ready}
        if not waits_for:
            time.sleep(LOOK_S / 4)
            return
        over, _ = self._ray.wait(list(waits_for), num_returns=1, timeout=LOOK_S)
        for reference in over:
            process = waits_for[reference]
            if process.ready:
                process.waits_for = None
                yield from self._over(process, reference)
            else:
                self._crew.begun(process)

    def _over(self, process: Process, reference: Any) -> Iterator[Outcome]:
        """A job is over, or its process is lost."""
        given, process.given = process.given, None
        assert given is not None
        try:
            value, error, files = loads(self._ray.get(reference))
        except self._ray.exceptions.RayTaskError as failure:
            yield Outcome(given.number, given.job, None, RuntimeError(first_line(failure)))
        except self._ray.exceptions.RayError as failure:
            yield from self._lost(process, given, failure)
        else:
            if self._files and files and error is None:
                try:
                    bring_home(self._files.out, files, self._files.whole)
                except OSError as refusal:
                    error = refusal
            yield Outcome(given.number, given.job, None if error else value, error)

    def _lost(self, process: Process, given: _Given, failure: Exception) -> Iterator[Outcome]:
        self._crew.drop(process)
        node = self._crew.nodes[process.node].name
        given.losses.append(f"{type(failure).__name__} on node {node}")
        if len(given.losses) < MAX_ATTEMPTS:
            tell(f"note: node {node} has lost a process; its job is done again ({type(failure).__name__})")
            self._again.append(given)
            return
        words = (
            f"its process was lost {MAX_ATTEMPTS} times ({'; '.join(given.losses)}); memory may have run out: give "
            f"nodes fewer cores (ray start --num-cpus), or see Ray's logs: {first_line(failure)}"
        )
        yield Outcome(given.number, given.job, None, WorkerDiedError(words))
