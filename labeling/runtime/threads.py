"""How many threads work side by side, and work spread over them in order."""

import os
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
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
_beside = threading.local()
"""Of this thread: whether it works beside others that have all cores to do with."""


def num_threads() -> int:
    """As many as ``NUMBA_NUM_THREADS`` says, which bounds the compiled code too; else one for each usable core.

    One in a thread of ``one_beside``.
    """
    if getattr(_beside, "alone", False):
        return 1
    told = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(told) if told.isdigit() and int(told) > 0 else len(os.sched_getaffinity(0))


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
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


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
