"""Progress reports of long work: the code that does the work reports its stage, a progress bar shows it.

>>> from labeling.runtime.progress import progress_reported_to, report_progress, view_counter
>>> with progress_reported_to(print):
...     report_progress("segmenting 3 objects")
...     count_views = view_counter("reading", 200)
...     count_views(1)
segmenting 3 objects
reading 1/200 views
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_thread = threading.local()
"""``callback``: what this thread reports to. Reports of other threads do not reach it."""


@contextmanager
def progress_reported_to(callback: Callable[[str], object]) -> Iterator[None]:
    """Passes every stage that this thread reports within the block to ``callback``; blocks can be nested."""
    before = getattr(_thread, "callback", None)
    _thread.callback = callback
    try:
        yield
    finally:
        _thread.callback = before


def report_progress(stage: str) -> None:
    """Reports the stage that begins now; does nothing outside ``progress_reported_to``."""
    callback = getattr(_thread, "callback", None)
    if callback is not None:
        callback(stage)


def view_counter(stage: str, total: int) -> Callable[[int], None]:
    """A function that is called with the number of views just done, and reports how many of ``total`` are done."""
    done = 0

    def more(views: int) -> None:
        nonlocal done
        done += views
        report_progress(f"{stage} {done}/{total} views")

    return more
