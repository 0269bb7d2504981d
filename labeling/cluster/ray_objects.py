"""Objects with a state on the nodes of a cluster: made there, called from here.

Jobs are forgotten once they are done; an object stays, in one process after the other if its processes are lost. Then
it is as new: whoever calls it knows how to bring it back to where it was.
"""

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Hashable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from labeling.cluster.cluster_config import ClusterConfig, SameThere
from labeling.cluster.ray_connection import connect, tell
from labeling.cluster.ray_orders import module_of, orders_for
from labeling.cluster.ray_processes import LOOK_S, Process, Processes, first_line
from labeling.cluster.travel import dumps, loads
from labeling.core.errors import UsageError
from labeling.runtime.process_pool import PerProcess, WorkerDiedError

START_S = 60.0
"""So long further processes may take to start, once there is one."""

Make = Callable[[Any], Any]
"""Makes an object from its key."""
Call = tuple[Hashable, str, tuple[Any, ...]]
"""Key of an object, name of a method, arguments."""


class RemoteObjects:
    """Objects by their keys, each in one of the processes of a cluster."""

    def __init__(
        self,
        make: Make,
        limit: int,
        where: ClusterConfig,
        common: Sequence[Path] = (),
        same: Sequence[SameThere] = (),
    ) -> None:
        """Starts processes, one for each core of the cluster.

        Args:
            make: makes an object from its key, in the process that it is to live in; picklable, as keys are.
            limit: at most so many processes.
            where: the cluster.
            common: files and folders that all objects read.
            same: what must be the same on all nodes besides code, libraries and weights.

        Raises:
            SbmError: if there is no such cluster, none of its nodes is as this machine, or the files do not fit.
        """
        connect(where.cluster)
        import ray

        self._ray = ray
        self._homes: dict[Hashable, Process] = {}
        self._answers: dict[Hashable, Any] = {}
        with contextlib.ExitStack() as stack:
            work = PerProcess(partial(_Home, make))
            orders = stack.enter_context(orders_for(work, module_of(make), where, same))
            if where.shared is not None:
                _check_below(where.shared, common)
                common = ()
            self._processes = Processes(orders, limit, common=common)
            stack.callback(self._processes.stop)
            self._start()
            self._stack = stack.pop_all()

    @property
    def num_processes(self) -> int:
        """How many processes there are, at least one."""
        return len(self._processes.all)

    def call(self, key: Hashable, method: str, *arguments: Any) -> None:
        """Has an object begin to do something; it is made if it is not there. One thing at a time.

        Raises:
            SbmError: if there has been no node for it for long.
        """
        if key not in self._homes:
            self._homes[key] = self._home()
            self._homes[key].given = key
        actor = self._homes[key].actor
        self._answers[key] = actor.do.remote(dumps((key, method, arguments)), None)

    def answer(self, key: Hashable) -> Any:
        """What came of the last call of an object.

        Raises:
            WorkerDiedError: if its process is lost; the object will be made anew when it is called again.
            Exception: what the method has raised.
        """
        errors = self._ray.exceptions
        try:
            value, error, _ = loads(self._ray.get(self._answers.pop(key)))
        except errors.RayTaskError as failure:
            raise RuntimeError(first_line(failure)) from None
        except errors.RayError as failure:
            process = self._homes.pop(key)
            self._processes.drop(process)
            told = f"{type(failure).__name__} on node {self._processes.nodes[process.node].name}"
            tell(f"note: a process is lost; what it held is made anew elsewhere ({told})")
            raise WorkerDiedError(told) from None
        if error is not None:
            raise error
        return value

    def close(self) -> None:
        """Ends all processes, and the objects with them."""
        self._stack.close()

    def _start(self) -> None:
        """Waits until there are processes.

        Raises:
            SbmError: if no node can be used, or there has been none for long.
        """
        late_s = float("inf")
        while True:
            self._processes.look()
            starting = [process for process in self._processes.all if not process.ready]
            if len(starting) < self.num_processes:
                late_s = min(late_s, time.monotonic() + START_S)
                if not starting:
                    return
                if time.monotonic() > late_s:
                    for process in starting:
                        self._processes.drop(process)
                    return
            self._wait(starting)

    def _wait(self, starting: Sequence[Process]) -> None:
        """Waits a while for processes that are being started."""
        if not starting:
            time.sleep(LOOK_S / 4)
            return
        waits_for = {process.waits_for: process for process in starting}
        for reference in self._ray.wait(list(waits_for), num_returns=1, timeout=LOOK_S)[0]:
            self._processes.begun(waits_for[reference])

    def _home(self) -> Process:
        """The process with the fewest objects; on nodes with a free core one is started first."""
        if any(process.ready for process in self._processes.all) and self._least()[0] == 0:
            return self._least()[1]
        self._start()
        return self._least()[1]

    def _least(self) -> tuple[int, Process]:
        """The fewest objects that a process has, and that process."""
        loads_of = Counter(id(process) for process in self._homes.values())
        ready = [process for process in self._processes.all if process.ready]
        least = min(ready, key=lambda process: loads_of[id(process)])
        return loads_of[id(least)], least


class _Home:
    """The objects of one process."""

    def __init__(self, make: Make) -> None:
        self._make = make
        self._objects: dict[Hashable, Any] = {}

    def __call__(self, call: Call) -> Any:
        key, method, arguments = call
        if key not in self._objects:
            self._objects[key] = self._make(key)
        return getattr(self._objects[key], method)(*arguments)


def _check_below(shared: Path, paths: Sequence[Path]) -> None:
    for path in paths:
        if not path.resolve().is_relative_to(shared.resolve()):
            raise UsageError(f"--shared {shared}: {path} does not lie below it, so that nodes cannot see it")
