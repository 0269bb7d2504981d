"""Freed memory, returned to the system."""

import contextlib
import ctypes
import sys


def trim_memory() -> None:
    """Returns freed memory to the system: the C allocator may hold hundreds of megabytes of it. Linux only."""
    if sys.platform == "linux":
        with contextlib.suppress(AttributeError):  # not every C library has it
            ctypes.CDLL(None).malloc_trim(0)
