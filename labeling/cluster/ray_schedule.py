"""Which process on which node does which job, and what becomes of jobs whose process is lost."""

import contextlib
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from labeling.cluster.cluster_config import JobFiles
from labeling.cluster.ray_connection import tell
from labeling.cluster.ray_worker import Orders, Worker
from labeling.cluster.travel import bring_home, dumps, loads, num_bytes, pack
from labeling.core.errors import SbmError
from labeling.runtime.process_pool import Outcome, WorkerDiedError

MAX_ATTEMPTS = 3
"""So often a job is given to a process that is then lost, before it is given up."""
LOOK_S = 1.0
"""Between looks at which nodes there are."""
PATIENCE_S = 300.0
"""So long the work waits for a node, once none is left."""
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


@dataclass
class _Process:
    """A worker process on a node."""

    actor: Any
    node: str
    waits_for: Any
    """Reference to what it was told last."""
    given: _Given | None = None
    ready: bool = False


@dataclass
class _Node:
    """A node of the cluster."""

    name: str
    places: int
    """Processes that it has room for."""
    gpus: bool
    """Whether each of them gets a GPU."""
    store_bytes: int
    problem: str | None = None
    """Why it is not used."""
    failed_starts: int = 0


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

        self._ray, self._orders, self._limit = ray, orders, limit
        self._files, self._is_shared, self._gpus = files, is_shared, gpus
        self.processes: list[_Process] = []
        self._nodes: dict[str, _Node] = {}
        self._again: deque[_Given] = deque()
        self._next_look_s = 0.0
        self._alone_since_s: float | None = None
        self._here = ray.get_runtime_context().get_node_id()
        self._common = None
        if files and not is_shared and files.common:
            self._see_nodes()
            size = num_bytes(files.common)
            if problem := self._too_large(size, "what all jobs read"):
                raise SbmError(problem)
            self._common = self._put(pack(files.common))

    def outcomes(self, jobs: Iterable[Any], may_begin: Callable[[], bool]) -> Generator[Outcome, None, None]:
        """How it went with each job, as they come."""
        waiting = enumerate(jobs)
        held: _Given | Outcome | None = None
        ended = False
        while True:
            self._look()
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
        for process in self.processes:
            with contextlib.suppress(Exception):  # it, its node or the cluster may be gone
                self._ray.kill(process.actor)
        self.processes.clear()

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
        if problem := self._too_large(given.bytes, ", ".join(str(path) for path in paths[:1])):
            raise SbmError(problem)
        given.files = self._put(pack(paths))

    def _too_large(self, size: int, what: str) -> str | None:
        """The sentence for what does not fit into the object stores."""
        for node in self._nodes.values():
            if node.problem is None and size > 0.8 * node.store_bytes:
                return (
                    f"{what}: {size / 1e6:.0f} MB are too many for the object store of node {node.name}, of "
                    f"{node.store_bytes / 1e6:.0f} MB; start it with a larger --object-store-memory, or give --shared"
                )
        return None

    def _put(self, data: bytes) -> Any:
        try:
            return self._ray.put(data)
        except self._ray.exceptions.RayError as error:
            words = str(error).strip().splitlines()[0]
            raise SbmError(f"the object store takes no {len(data) / 1e6:.0f} MB ({words}); give --shared") from None

    def _fits(self, given: _Given, process: _Process) -> bool:
        """Whether the inputs on the way leave room for those of one more job."""
        for node, others in ((self._here, self.processes), (process.node, self._on(process.node))):
            on_the_way = sum(other.given.bytes for other in others if other.given)
            limit = STORE_SHARE * self._nodes[node].store_bytes if node in self._nodes else float("inf")
            if on_the_way and on_the_way + given.bytes > limit:
                return False
        return True

    def _on(self, node: str) -> list[_Process]:
        return [process for process in self.processes if process.node == node]

    def _free(self) -> _Process | None:
        return next((process for process in self.processes if process.ready and process.given is None), None)

    def _give(self, process: _Process, given: _Given) -> None:
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
            process.waits_for = None
            if process.ready:
                yield from self._over(process, reference)
            else:
                self._begun(process, reference)

    def _begun(self, process: _Process, reference: Any) -> None:
        """A process has begun, or not."""
        node = self._nodes[process.node]
        try:
            problems = self._ray.get(reference)
        except (self._ray.exceptions.RayActorError, self._ray.exceptions.ActorUnschedulableError) as error:
            self.processes.remove(process)
            node.failed_starts += 1
            if node.failed_starts < MAX_ATTEMPTS:
                return
            problems = [_first_line(error)]
        except Exception as error:  # such as code that is not installed there
            problems = [_first_line(error)]
        if problems:
            self._refuse(node, process.node, "; ".join(problems))
            return
        process.ready = True
        node.failed_starts = 0

    def _refuse(self, node: _Node, identity: str, problem: str) -> None:
        """Leaves out a node."""
        if node.problem is None:
            node.problem = problem
            tell(f"note: node {node.name} is not used ({problem})")
        for process in self._on(identity):
            if process.given is None:  # what has begun before is as good as any
                self._drop(process)

    def _drop(self, process: _Process) -> None:
        if process in self.processes:
            self.processes.remove(process)
        with contextlib.suppress(Exception):
            self._ray.kill(process.actor)

    def _over(self, process: _Process, reference: Any) -> Iterator[Outcome]:
        """A job is over, or its process is lost."""
        given, process.given = process.given, None
        assert given is not None
        try:
            value, error, files = loads(self._ray.get(reference))
        except self._ray.exceptions.RayTaskError as failure:
            yield Outcome(given.number, given.job, None, RuntimeError(_first_line(failure)))
        except self._ray.exceptions.RayError as failure:
            yield from self._lost(process, given, failure)
        else:
            if self._files and files and error is None:
                try:
                    bring_home(self._files.out, files, self._files.whole)
                except OSError as refusal:
                    error = refusal
            yield Outcome(given.number, given.job, None if error else value, error)

    def _lost(self, process: _Process, given: _Given, failure: Exception) -> Iterator[Outcome]:
        self._drop(process)
        node = self._nodes[process.node].name
        given.losses.append(f"{type(failure).__name__} on node {node}")
        if len(given.losses) < MAX_ATTEMPTS:
            tell(f"note: node {node} has lost a process; its job is done again ({type(failure).__name__})")
            self._again.append(given)
            return
        words = (
            f"its process was lost {MAX_ATTEMPTS} times ({'; '.join(given.losses)}); memory may have run out: give "
            f"nodes fewer cores (ray start --num-cpus), or see Ray's logs: {_first_line(failure)}"
        )
        yield Outcome(given.number, given.job, None, WorkerDiedError(words))

    def _look(self) -> None:
        """Sees which nodes there are, and places processes on their cores.

        Raises:
            SbmError: if no node can be used, or none has been there for long.
        """
        now_s = time.monotonic()
        if now_s < self._next_look_s:
            return
        self._next_look_s = now_s + LOOK_S
        alive = self._see_nodes()
        with_places = [one for one in alive if self._nodes[one].problem is None and self._nodes[one].places]
        problems = [f"{node.name}: {node.problem}" for node in self._nodes.values() if node.problem is not None]
        if problems and not with_places and not self.processes:
            raise SbmError(f"no node of the cluster can be used ({'; '.join(problems)})")
        if with_places or self.processes:
            self._alone_since_s = None
        elif self._alone_since_s is None:
            self._alone_since_s = now_s
            tell("note: the cluster has no node with a core now; waiting for one")
        elif now_s - self._alone_since_s > PATIENCE_S:
            raise SbmError(f"the cluster has had no node for {PATIENCE_S / 60:.0f} minutes; the same command goes on")
        # In turns, so that a few processes are spread over all nodes.
        for turn in range(max((self._nodes[one].places for one in with_places), default=0)):
            for identity in with_places:
                if len(self.processes) >= self._limit:
                    return
                if turn < self._nodes[identity].places and len(self._on(identity)) <= turn:
                    self.processes.append(self._start(identity))

    def _see_nodes(self) -> list[str]:
        """The nodes that there are now."""
        alive = {node["NodeID"]: node for node in self._ray.nodes() if node["Alive"]}
        for identity, node in alive.items():
            if identity not in self._nodes:
                self._nodes[identity] = self._node(node)
        return list(alive)

    def _node(self, node: dict[str, Any]) -> _Node:
        resources = node["Resources"]
        gpus = int(resources.get("GPU", 0)) if self._gpus else 0
        cores = int(resources.get("CPU", 0))
        store = int(resources.get("object_store_memory", 0)) or sys.maxsize
        name = node.get("NodeManagerAddress") or node["NodeID"][:8]
        return _Node(f"{name} ({node['NodeID'][:6]})", min(gpus or cores, cores), bool(gpus), store)

    def _start(self, identity: str) -> _Process:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        remote = self._ray.remote(Worker).options(
            num_cpus=1,
            num_gpus=1 if self._nodes[identity].gpus else 0,
            max_restarts=0,
            max_task_retries=0,
            scheduling_strategy=NodeAffinitySchedulingStrategy(identity, soft=False),
        )
        actor = remote.remote()
        return _Process(actor, identity, actor.begin.remote(self._orders, self._common))


def _first_line(error: Exception) -> str:
    """What an error of a cluster says, on one line: Ray's own have tracebacks in them."""
    cause = getattr(error, "cause", None)
    told = cause if isinstance(cause, Exception) else error
    lines = [line.strip() for line in str(told).splitlines() if line.strip()]
    return (lines[-1] if isinstance(cause, Exception) else lines[0])[:300] if lines else type(error).__name__
