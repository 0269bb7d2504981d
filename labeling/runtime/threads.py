"""How many threads work side by side, and work spread over them in order."""

import os
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

THREAD_VARIABLES = (
    "NUMBA_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""What libraries read, when they are first loaded, to learn how many threads they may use."""

Item = TypeVar("Item")
Result = TypeVar("Result")

_HANDOVER_S = 3e-4
_asked_for: ContextVar[int | None] = ContextVar("_asked_for", default=None)
"""Threads that networks are to compute in, where somebody has said so."""
_beside = threading.local()
"""Of this thread: whether it works beside others that have all cores to do with."""


def num_threads() -> int:
    """As many as ``NUMBA_NUM_THREADS`` says, which bounds the compiled code too; else one for each usable core.

    One in a thread of ``one_beside``.
    """
    if getattr(_beside, "alone", False):
        return 1
    return _told("NUMBA_NUM_THREADS") or len(os.sched_getaffinity(0))


def _told(variable: str) -> int | None:
    told = os.environ.get(variable, "")
    return int(told) if told.isdigit() and int(told) > 0 else None


@contextmanager
def one_beside() -> Iterator[ThreadPoolExecutor]:
    """Yields one thread that works in turn on what it is given; what has not begun at the end of the block is dropped.

    What it does is spread over no further threads: the block has enough to do for all cores itself. Threads hand over
    Python's lock sooner than usual, since either side may do much in Python itself.
    """
    before = sys.getswitchinterval()
    with ThreadPoolExecutor(1, initializer=setattr, initargs=(_beside, "alone", True)) as pool:
        try:
            sys.setswitchinterval(_HANDOVER_S)
            yield pool
        finally:
            sys.setswitchinterval(before)
            pool.shutdown(cancel_futures=True)


@contextmanager
def in_background(work: Callable[[], Result]) -> Iterator[Callable[[], Result]]:
    """Starts ``work`` on another thread, if there is one; yields a function that waits for its result."""
    if num_threads() == 1:
        yield work
        return
    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(work).result


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Results of ``work`` in the order of the items; worth it where the work leaves Python's lock to others."""
    return list(as_they_come(work, items))


def as_they_come(work: Callable[[Item], Result], items: Iterable[Item]) -> Generator[Result, None, None]:
    """Yields what ``in_threads`` returns, each result as soon as it is there; to be closed if not taken to its end."""
    if num_threads() == 1:
        yield from map(work, items)
        return
    with ThreadPoolExecutor(num_threads()) as pool:
        yield from pool.map(work, items)


@contextmanager
def one_network_thread() -> Iterator[None]:
    """PyTorch computes in one thread meanwhile.

    More of them add in another order: confidences differ in the fifth digit, and a robot that decides by them goes
    another way.
    """
    import torch

    before = torch.get_num_threads()
    token = _asked_for.set(1)
    try:
        settle_network_threads()
        yield
    finally:
        _asked_for.reset(token)
        torch.set_num_threads(before)


def settle_network_threads() -> None:
    """Has PyTorch compute in as many threads as it should from now on, whatever runs beside it: one in the block of
    ``one_network_thread``, else as many as ``OMP_NUM_THREADS`` says, else one for each usable core.

    When numba's first parallel loop runs, it tells OpenMP how many threads there are, and PyTorch, which shares OpenMP
    with it, follows: the last digits of what networks compute would hang on whether labels were made before, or after a
    kill no more. So numba tells it first, here.
    """
    import numba
    import torch

    numba.get_num_threads()  # begins its threads
    torch.set_num_threads(_asked_for.get() or _told("OMP_NUM_THREADS") or len(os.sched_getaffinity(0)))


@contextmanager
def threads_of_children(count: int) -> Iterator[None]:
    """Lets each process that is started meanwhile compute in so many threads."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
