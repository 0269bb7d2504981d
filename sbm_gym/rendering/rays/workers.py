"""Threads that share the work of compiled kernels."""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

MIN_RAYS = 2048
"""Rays for which another thread is worth its start."""
MIN_RAYS_OF_A_MOMENT = 16_384
"""The same where little is done with each ray."""


class Workers:
    """Splits ranges of rays over threads. Kernels release the interpreter lock, so plain threads suffice."""

    def __init__(self, threads: int) -> None:
        """Starts the threads.

        Args:
            threads: how many; no more than that run at any time.
        """
        self.threads = threads
        self._pool = ThreadPoolExecutor(threads - 1) if threads > 1 else None

    def split(self, kernel: Callable[..., None], count: int, *arguments: object, least: int = MIN_RAYS) -> None:
        """Calls ``kernel(start, stop, *arguments)`` for parts that cover ``range(count)``, none below ``least``."""
        parts = min(self.threads, max(count // least, 1))
        if parts == 1 or self._pool is None:
            kernel(0, count, *arguments)
            return
        bounds = [count * part // parts for part in range(parts + 1)]
        others = [self._pool.submit(kernel, a, b, *arguments) for a, b in itertools.pairwise(bounds[1:])]
        kernel(bounds[0], bounds[1], *arguments)
        for other in others:
            other.result()
