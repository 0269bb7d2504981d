"""Jobs done side by side in worker processes.

>>> from labeling.runtime.process_pool import run_jobs
>>> for outcome in run_jobs(len, ["a", "bcd"], workers=1):
...     print(outcome.job, outcome.result())
a 1
bcd 3
"""

import contextlib
import functools
import itertools
import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Sized
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.context import SpawnProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any, Generic, TypeVar

from labeling.core.errors import SbmError
from labeling.runtime.interrupts import exit_once, heed_lost_stops, hold_back_interrupts
from labeling.runtime.threads import num_threads, threads_of_children

Job = TypeVar("Job")
Result = TypeVar("Result")

_PATIENCE_S = 10.0
"""So long a worker may take to remove its temporary files, once it is told to end."""


class WorkerDiedError(SbmError):
    """A worker process ended in the middle of a job."""


@dataclass(frozen=True)
class PerProcess(Generic[Job, Result]):
    """Work that needs something made once in each process: an environment, a detector, a policy."""

    make: Callable[[], Callable[[Job], Result]]
    """Called once in each process, before its first job; returns what does the jobs."""


Work = Callable[[Job], Result] | PerProcess[Job, Result]


@dataclass(frozen=True)
class Outcome(Generic[Job, Result]):
    """How it went with one job."""

    number: int
    """Of the job, from 0."""
    job: Job
    value: Result | None
    error: Exception | None
    """What the job raised, or ``WorkerDiedError``; None if it was done."""

    def result(self) -> Result:
        """What the job returned; raises what it raised."""
        if self.error is not None:
            raise self.error
        return self.value  # type: ignore[return-value]


def run_jobs(
    work: Work[Job, Result],
    jobs: Iterable[Job],
    workers: int,
    *,
    threads: int | None = 1,
    ordered: bool = False,
    always_spawn: bool = False,
) -> Generator[Outcome[Job, Result], None, None]:
    """Does jobs in several processes; one that fails, or that its process dies of, does not keep others from theirs.

    Closing the generator (``contextlib.closing``), or an exception in the loop over it, ends all processes: they remove
    their temporary files. If this process dies, they end, too.

    Args:
        work: what to do with a job: a function of a module, or other picklable callable, or ``PerProcess``.
        jobs: what to give it; picklable. Taken only as workers become free, so that they may be without end.
        workers: how many processes; never more than jobs. With one, the jobs are done in this process.
        threads: of each process; None shares out those of this process.
        ordered: yield outcomes in the order of the jobs, not as they come.
        always_spawn: use a process of its own for a single worker, too.

    Yields:
        How it went with each job.
    """
    if isinstance(jobs, Sized):
        workers = min(workers, len(jobs))
    if workers < 1:
        return
    if workers == 1 and not always_spawn:
        yield from _run_here(work, jobs)
    else:
        threads = threads or max(1, num_threads() // workers)
        yield from _run_in_processes(_Workers(work, workers, threads), jobs, ordered)


def map_jobs(
    work: Work[Job, Result], jobs: Iterable[Job], workers: int, *, threads: int | None = 1, ordered: bool = False
) -> Generator[Result, None, None]:
    """Results of jobs that are all needed: the first error ends the work. Arguments are those of ``run_jobs``.

    Returns:
        What the jobs return, as it comes.

    Raises:
        Exception: the first that a job raises, or ``WorkerDiedError``, once the jobs that were begun are finished.
    """
    if isinstance(jobs, Sized):  # what ``needed_results`` passes on is not
        workers = min(workers, len(jobs))
    run = functools.partial(run_jobs, work, workers=workers, threads=threads, ordered=ordered)
    return needed_results(run, jobs)


def needed_results(
    run: Callable[[Iterable[Job]], Generator[Outcome[Job, Result], None, None]], jobs: Iterable[Job]
) -> Generator[Result, None, None]:
    """What ``map_jobs`` yields, of any way to do jobs.

    Args:
        run: does jobs, such as ``run_jobs``.
        jobs: what to give it.

    Yields:
        What the jobs return.

    Raises:
        Exception: the first that a job raises, once the jobs that were begun are finished.
    """
    errors: list[Exception] = []
    begun = itertools.takewhile(lambda _: not errors, jobs)
    with contextlib.closing(run(begun)) as outcomes:
        for outcome in outcomes:
            if outcome.error is not None:
                errors.append(outcome.error)
            elif not errors:
                yield outcome.result()
    if errors:
        raise errors[0]


def function_of(work: Work[Job, Result]) -> Callable[[Job], Result]:
    """What does the jobs; what it needs is made for the first of them."""
    if not isinstance(work, PerProcess):
        return work
    made = functools.cache(work.make)
    return lambda job: made()(job)


def _run_here(work: Work[Job, Result], jobs: Iterable[Job]) -> Generator[Outcome[Job, Result], None, None]:
    do = function_of(work)
    for number, job in enumerate(jobs):
        try:
            value = do(job)
        except Exception as error:  # for the caller to judge
            yield Outcome(number, job, None, error)
        else:
            yield Outcome(number, job, value, None)


def _run_in_processes(
    workers: "_Workers", jobs: Iterable[Job], ordered: bool
) -> Generator[Outcome[Job, Any], None, None]:
    waiting = enumerate(jobs)
    early: dict[int, Outcome[Job, Any]] = {}
    """Done before others that come before them; if they become many, workers wait."""
    due, most_early = 0, 4 * workers.limit
    try:
        while True:
            while len(workers.busy) < workers.limit and len(early) < most_early and (given := next(waiting, None)):
                workers.begin(*given)
            if not workers.busy:
                return
            for outcome in workers.wait():
                if ordered:
                    early[outcome.number] = outcome
                else:
                    yield outcome
            while due in early:
                yield early.pop(due)
                due += 1
    finally:
        workers.stop()


class _Workers:
    """Processes that do one job each at a time; a dead one is replaced when there is a job for it."""

    def __init__(self, work: Work[Any, Any], limit: int, threads: int) -> None:
        self._work, self._threads = work, threads
        self.limit = limit
        """How many there are at most."""
        self._processes: dict[connection.Connection, SpawnProcess] = {}
        self.busy: dict[connection.Connection, tuple[int, Any]] = {}
        """Number of the job and job, by the pipe to its worker."""

    def begin(self, number: int, job: Any) -> None:
        """Gives a job to a free worker."""
        pipe = next((pipe for pipe in self._processes if pipe not in self.busy), None) or self._start()
        self.busy[pipe] = number, job
        with contextlib.suppress(ConnectionError):  # it has died; whoever waits for the answer learns so
            pipe.send(job)

    def wait(self) -> list[Outcome[Any, Any]]:
        """Waits until at least one job is over."""
        outcomes = []
        for pipe in connection.wait(list(self.busy)):
            assert isinstance(pipe, connection.Connection)
            try:
                value, error = pipe.recv()
            except (EOFError, ConnectionError):
                process = self._processes.pop(pipe)
                process.join()
                pipe.close()
                code = process.exitcode  # negative: number of a signal
                words = f"a worker process ended with exit code {code}; memory may have run out (try fewer --workers)"
                value, error = None, WorkerDiedError(words)
            outcomes.append(Outcome(*self.busy.pop(pipe), value, error))
        return outcomes

    def stop(self) -> None:
        """Ends all workers and waits for them; files that they are writing disappear."""
        for pipe, process in self._processes.items():
            pipe.close()
            process.terminate()
        for process in self._processes.values():
            process.join(_PATIENCE_S)
            process.kill()
            process.join()
        self._processes.clear()
        self.busy.clear()

    def _start(self) -> connection.Connection:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(self._work, theirs), daemon=True)
        with threads_of_children(self._threads), hold_back_interrupts():
            process.start()
        theirs.close()
        self._processes[ours] = process
        return ours


def _serve(work: Work[Any, Any], pipe: connection.Connection) -> None:
    """What a worker process does: the jobs that come through the pipe, until it closes."""
    # Ctrl-C, and the end of a terminal, reach all its processes; the first decides, and ends others in its own time.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, exit_once)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import cv2

    cv2.setNumThreads(num_threads())
    do = function_of(work)
    with heed_lost_stops():
        with contextlib.suppress(EOFError, ConnectionError):
            while True:
                job = pipe.recv()
                try:
                    answer = ForkingPickler.dumps((do(job), None))
                except Exception as error:  # judged by the process that gave the job
                    answer = ForkingPickler.dumps((None, sendable(error)))
                pipe.send_bytes(answer)
        # It ends by itself; told so meanwhile, it would print a traceback from whatever it is clearing away.
        signal.signal(signal.SIGTERM, signal.SIG_IGN)


def sendable(error: Exception) -> Exception:
    """What a job raised, with a note that says where; or a ``RuntimeError`` that says both, if it cannot be pickled."""
    text = "".join(traceback.format_exception(error))
    error.add_note(f"in a worker process:\n{text}")
    try:
        pickle.loads(ForkingPickler.dumps(error))
    except Exception:  # errors with arguments of their own do not always survive
        return RuntimeError(text)
    return error


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_PATIENCE_S)  # this thread ends with the process; only if that hangs does it get past here
        os.kill(os.getpid(), signal.SIGKILL)
