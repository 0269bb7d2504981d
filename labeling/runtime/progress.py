"""Where long work is: what does it tells, and whoever draws a progress bar listens.

>>> from labeling.runtime.progress import listening, tell, views_told
>>> with listening(print):
...     tell("segmenting 3 objects")
...     looked = views_told("reading", 200)
...     looked(1)
segmenting 3 objects
reading 1/200 views
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_ears = threading.local()
"""Of this thread: ``hear``, who listens. What other threads do beside it is no news."""


@contextmanager
def listening(hear: Callable[[str], object]) -> Iterator[None]:
    """Hands what this thread tells in the block to ``hear``."""
    before = getattr(_ears, "hear", None)
    _ears.hear = hear
    try:
        yield
    finally:
        _ears.hear = before


def tell(stage: str) -> None:
    """Says what begins now; free where nobody listens."""
    hear = getattr(_ears, "hear", None)
    if hear is not None:
        hear(stage)


def views_told(stage: str, total: int) -> Callable[[int], None]:
    """A function that takes how many more views are done, and tells how many are in all."""
    done = 0

    def more(views: int) -> None:
        nonlocal done
        done += views
        tell(f"{stage} {done}/{total} views")

    return more
