"""The processes of a cluster: one (a Ray actor) on each core of each node, as nodes come and go."""

import contextlib
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.cluster.ray_connection import tell
from labeling.cluster.ray_worker import Orders, Worker
from labeling.cluster.travel import num_bytes, pack
from labeling.core.errors import SbmError

MAX_ATTEMPTS = 3
"""So often something is begun by a process that is then lost, before it is given up."""
LOOK_S = 1.0
"""Between looks at which nodes there are."""
PATIENCE_S = 300.0
"""So long the work waits for a node, once none is left."""


@dataclass(eq=False)
class Process:
    """A worker process on a node."""

    actor: Any
    node: str
    waits_for: Any
    """Reference to what it was told last."""
    given: Any = None
    """What it does now; None if nothing."""
    ready: bool = False


@dataclass
class Node:
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


class Processes:
    """Those that work for this machine, on all nodes together."""

    def __init__(self, orders: Orders, limit: int, gpus: bool = False, common: Sequence[Path] = ()) -> None:
        """Starts none yet.

        Args:
            orders: what they are told first.
            limit: at most so many.
            gpus: whether each gets a GPU, on nodes that have some.
            common: files that each of them needs, if they travel.

        Raises:
            SbmError: if these do not fit into the object stores.
        """
        import ray

        self._ray, self._orders, self._limit, self._gpus = ray, orders, limit, gpus
        self.all: list[Process] = []
        self.nodes: dict[str, Node] = {}
        """By their identities."""
        self._next_look_s = 0.0
        self._alone_since_s: float | None = None
        self._common = None
        if common:
            self._see_nodes()
            size = num_bytes(common)
            if problem := self.too_large(size, "what all jobs read"):
                raise SbmError(problem)
            self._common = self.put(pack(common))

    def look(self) -> None:
        """Sees which nodes there are, and places processes on their cores.

        Raises:
            SbmError: if no node can be used, or none has been there for long.
        """
        now_s = time.monotonic()
        if now_s < self._next_look_s:
            return
        self._next_look_s = now_s + LOOK_S
        alive = self._see_nodes()
        with_places = [one for one in alive if self.nodes[one].problem is None and self.nodes[one].places]
        problems = [f"{node.name}: {node.problem}" for node in self.nodes.values() if node.problem is not None]
        if problems and not with_places and not self.all:
            raise SbmError(f"no node of the cluster can be used ({'; '.join(problems)})")
        if with_places or self.all:
            self._alone_since_s = None
        elif self._alone_since_s is None:
            self._alone_since_s = now_s
            tell("note: the cluster has no node with a core now; waiting for one")
        elif now_s - self._alone_since_s > PATIENCE_S:
            raise SbmError(f"the cluster has had no node for {PATIENCE_S / 60:.0f} minutes; the same command goes on")
        # In turns, so that a few processes are spread over all nodes.
        for turn in range(max((self.nodes[one].places for one in with_places), default=0)):
            for identity in with_places:
                if len(self.all) >= self._limit:
                    return
                if turn < self.nodes[identity].places and len(self.on(identity)) <= turn:
                    self.all.append(self._start(identity))

    def begun(self, process: Process) -> None:
        """A process has answered what it was told first, or could not be started."""
        reference, process.waits_for = process.waits_for, None
        node = self.nodes[process.node]
        try:
            problems = self._ray.get(reference)
        except (self._ray.exceptions.RayActorError, self._ray.exceptions.ActorUnschedulableError) as error:
            self.all.remove(process)
            node.failed_starts += 1
            if node.failed_starts < MAX_ATTEMPTS:
                return
            problems = [first_line(error)]
        except Exception as error:  # such as code that is not installed there
            problems = [first_line(error)]
        if problems:
            self._refuse(node, process.node, "; ".join(problems))
            return
        process.ready = True
        node.failed_starts = 0

    def _refuse(self, node: Node, identity: str, problem: str) -> None:
        """Leaves out a node."""
        if node.problem is None:
            node.problem = problem
            tell(f"note: node {node.name} is not used ({problem})")
        for process in self.on(identity):
            if process.given is None:  # what has begun before is as good as any
                self.drop(process)

    def drop(self, process: Process) -> None:
        """Ends a process, or what is left of it; another may take its place."""
        if process in self.all:
            self.all.remove(process)
        self._next_look_s = 0.0
        with contextlib.suppress(Exception):
            self._ray.kill(process.actor)

    def stop(self) -> None:
        """Ends all processes."""
        for process in self.all:
            with contextlib.suppress(Exception):  # it, its node or the cluster may be gone
                self._ray.kill(process.actor)
        self.all.clear()

    def too_large(self, size: int, what: str) -> str | None:
        """The sentence for what does not fit into the object stores."""
        for node in self.nodes.values():
            if node.problem is None and size > 0.8 * node.store_bytes:
                return (
                    f"{what}: {size / 1e6:.0f} MB are too many for the object store of node {node.name}, of "
                    f"{node.store_bytes / 1e6:.0f} MB; start it with a larger --object-store-memory, or give --shared"
                )
        return None

    def put(self, data: bytes) -> Any:
        """A reference to bytes in the object store.

        Raises:
            SbmError: if it has no room.
        """
        try:
            return self._ray.put(data)
        except self._ray.exceptions.RayError as error:
            words = str(error).strip().splitlines()[0]
            raise SbmError(f"the object store takes no {len(data) / 1e6:.0f} MB ({words}); give --shared") from None

    def on(self, node: str) -> list[Process]:
        """The processes on a node."""
        return [process for process in self.all if process.node == node]

    def _see_nodes(self) -> list[str]:
        """The nodes that there are now."""
        alive = {node["NodeID"]: node for node in self._ray.nodes() if node["Alive"]}
        for identity, node in alive.items():
            if identity not in self.nodes:
                self.nodes[identity] = self._node(node)
        return list(alive)

    def _node(self, node: dict[str, Any]) -> Node:
        resources = node["Resources"]
        gpus = int(resources.get("GPU", 0)) if self._gpus else 0
        cores = int(resources.get("CPU", 0))
        store = int(resources.get("object_store_memory", 0)) or sys.maxsize
        name = node.get("NodeManagerAddress") or node["NodeID"][:8]
        return Node(f"{name} ({node['NodeID'][:6]})", min(gpus or cores, cores), bool(gpus), store)

    def _start(self, identity: str) -> Process:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        remote = self._ray.remote(Worker).options(
            num_cpus=1,
            num_gpus=1 if self.nodes[identity].gpus else 0,
            max_restarts=0,
            max_task_retries=0,
            scheduling_strategy=NodeAffinitySchedulingStrategy(identity, soft=False),
        )
        actor = remote.remote()
        return Process(actor, identity, actor.begin.remote(self._orders, self._common))


def first_line(error: Exception) -> str:
    """What an error of a cluster says, on one line: Ray's own have tracebacks in them."""
    cause = getattr(error, "cause", None)
    told = cause if isinstance(cause, Exception) else error
    lines = [line.strip() for line in str(told).splitlines() if line.strip()]
    return (lines[-1] if isinstance(cause, Exception) else lines[0])[:300] if lines else type(error).__name__
