"""Ctrl-C, SIGTERM and SIGHUP: to stop at the next good moment, or at once but without half-written files."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from multiprocessing import resource_tracker
from typing import Any

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that tell a program to stop: from the keyboard, from the system, from a terminal that closes."""


class StopRequest(threading.Event):
    """Set when the program is told to stop; remembers by which signal."""

    signal_number = int(signal.SIGINT)

    def leave(self) -> None:
        """Ends the program as the signal would have done.

        Raises:
            KeyboardInterrupt: after Ctrl-C.
            SystemExit: after another signal n, with the exit code 128 + n.
        """
        if self.signal_number == signal.SIGINT:
            raise KeyboardInterrupt
        raise_exit(self.signal_number)


@contextlib.contextmanager
def graceful_interrupt() -> Iterator[StopRequest]:
    """Yields an event that the first signal of ``STOPPING`` sets; the second one ends the program at once, as usual."""
    request = StopRequest()
    before = {number: signal.getsignal(number) for number in STOPPING}

    def note(number: int, frame: object) -> None:
        request.signal_number = number
        request.set()
        for one, handler in before.items():
            signal.signal(one, handler)

    with contextlib.ExitStack() as stack:
        for number in STOPPING:
            stack.enter_context(_handled(number, note))
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


@contextlib.contextmanager
def exit_when_told() -> Iterator[None]:
    """SIGTERM and SIGHUP end the program as an error does: temporary files are removed and worker processes ended."""
    with _handled(signal.SIGTERM, raise_exit), _handled(signal.SIGHUP, raise_exit):
        yield


@contextlib.contextmanager
def _handled(number: int, handler: Callable[[int, Any], None]) -> Iterator[None]:
    """Signals go to a handler until the block ends; other threads than the main one cannot say so.

    A signal that is ignored stays so: ``nohup`` means what it says.
    """
    before = signal.getsignal(number)
    if threading.current_thread() is not threading.main_thread() or before is signal.SIG_IGN:
        yield
        return
    signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


@contextlib.contextmanager
def heed_lost_stops() -> Iterator[None]:
    """Until the block ends, a signal whose exception Python can only ignore comes again.

    Signals are heeded wherever the program happens to be: in a destructor or in a callback from C the exception would
    be printed, with its traceback, and the program would go on as if nobody had told it to stop.
    """
    before = sys.unraisablehook

    def again(lost: "sys.UnraisableHookArgs") -> None:
        number = _signal_of(lost.exc_value)
        if number is None:
            before(lost)
            return
        if signal.getsignal(number) is signal.SIG_IGN:  # see ``exit_once``
            signal.signal(number, exit_once)
        timer = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), number))
        timer.daemon = True
        timer.start()

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = before


_AGAIN_S = 0.05
"""By then whatever swallowed the signal is over."""


def _signal_of(error: BaseException | None) -> int | None:
    """The signal that has raised an exception; None if none has."""
    if isinstance(error, KeyboardInterrupt):
        return int(signal.SIGINT)
    if isinstance(error, SystemExit) and isinstance(error.code, int) and error.code - 128 in STOPPING:
        return error.code - 128
    return None


def exit_once(number: int, frame: object = None) -> None:
    """As ``raise_exit``, once: told again, the process goes on ending.

    Raises:
        SystemExit: with 128 and the number of the signal.
    """
    signal.signal(number, signal.SIG_IGN)
    raise_exit(number)


def raise_exit(number: int, frame: object = None) -> None:
    """A signal handler that unwinds the stack and ends the process with the exit code of one that was told to.

    Raises:
        SystemExit: with 128 and the number of the signal.
    """
    raise SystemExit(128 + number)
