"""Work spread over processes, each of which makes what it works with once: an environment, policies, a detector."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from labeling.core.errors import SbmError
from labeling.runtime.threads import threads_of_children
from labeling.runtime.worker_process import serve_parent

Config = TypeVar("Config")
Tool = TypeVar("Tool")
Task = TypeVar("Task")


def in_processes(
    make: Callable[[Config], Tool],
    config: Config,
    work: Callable[[Tool, Task], object],
    tasks: Sequence[Task],
    workers: int,
) -> Iterator[Task]:
    """Works through tasks in processes of one thread each.

    Args:
        make: a function of a module, or a class; each process calls it once.
        config: what to give it; picklable.
        work: a function of a module, which keeps its outcome itself.
        tasks: what to give it after what ``make`` returned; picklable.
        workers: how many processes.

    Yields:
        Tasks as they are done.

    Raises:
        SbmError: if a process was killed, or a task raised it. Tasks that were begun are finished, no others begun.
    """
    context = multiprocessing.get_context("spawn")
    count = min(workers, len(tasks))
    with (
        threads_of_children(1),
        ProcessPoolExecutor(count, mp_context=context, initializer=_hire, initargs=(make, config)) as pool,
    ):
        running = {pool.submit(_work, work, task): task for task in tasks}
        try:
            for finished in as_completed(running):
                finished.result()
                yield running[finished]
        except BrokenProcessPool:
            raise SbmError("a worker process was killed; memory may have run out (try fewer --workers)") from None
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


_hired: list[Any] = []
"""What the process works with."""


def _hire(make: Callable[[Any], Any], config: Any) -> None:
    serve_parent()
    _hired.append(make(config))


def _work(work: Callable[[Any, Any], object], task: Any) -> None:
    work(_hired[0], task)
