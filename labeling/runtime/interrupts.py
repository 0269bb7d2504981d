"""Ctrl-C and SIGTERM: to stop at the next good moment, or at once but without half-written files."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from typing import Any

TERMINATED = 128 + signal.SIGTERM
"""Exit code of a process that was told to end."""


@contextlib.contextmanager
def graceful_interrupt() -> Iterator[threading.Event]:
    """Yields an event that the first Ctrl-C sets; the second one interrupts at once, as usual."""
    request, before = threading.Event(), signal.getsignal(signal.SIGINT)

    def note(number: int, frame: object) -> None:
        request.set()
        signal.signal(signal.SIGINT, before)

    with _handled(signal.SIGINT, note):
        yield request


@contextlib.contextmanager
def hold_back_interrupts() -> Iterator[None]:
    """Ctrl-C waits until the block ends, and never reaches processes that are started in it: they are told to stop."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Python starts this helper of its own with the first process, and then lets signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def exit_on_sigterm() -> contextlib.AbstractContextManager[None]:
    """SIGTERM ends the program as an error does: temporary files are removed and worker processes ended."""
    return _handled(signal.SIGTERM, raise_exit)


@contextlib.contextmanager
def _handled(number: int, handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Signals go to a handler until the block ends; other threads than the main one cannot say so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def raise_exit(*_: object) -> None:
    """A signal handler that unwinds the stack and ends the process with the exit code of one that was told to."""
    raise SystemExit(TERMINATED)
