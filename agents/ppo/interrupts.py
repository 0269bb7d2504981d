"""Ctrl-C as a wish to stop at the next good moment."""

import contextlib
import signal
import threading
from collections.abc import Iterable, Iterator
from typing import TypeVar

Item = TypeVar("Item")


class Wish:
    """Whether someone wants to stop."""

    def __init__(self) -> None:
        """Nobody does yet."""
        self.stop = False

    def granted(self, items: Iterable[Item]) -> Iterator[Item]:
        """The items, while nobody wants to stop.

        Raises:
            KeyboardInterrupt: once someone does.
        """
        for item in items:
            if self.stop:
                raise KeyboardInterrupt
            yield item


@contextlib.contextmanager
def stop_on_interrupt() -> Iterator[Wish]:
    """Yields a wish that the first Ctrl-C fulfils; the second one interrupts at once, as ever."""
    wish = Wish()
    if threading.current_thread() is not threading.main_thread():
        yield wish
        return
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: object) -> None:
        wish.stop = True
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, note)
    try:
        yield wish
    finally:
        signal.signal(signal.SIGINT, before)
