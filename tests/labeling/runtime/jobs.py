"""What worker processes do in tests; they import it by name."""

import os
import signal
import time
import weakref
from collections.abc import Callable
from pathlib import Path

from labeling.core.errors import SbmError
from labeling.formats.atomic import atomic_folder


def square(number: int) -> int:
    return number**2


def square_or_fail(number: int) -> int:
    """Kills its process at 9, raises at 13 and at 14."""
    if number == 9:
        os._exit(9)
    if number == 13:
        raise SbmError("13 is unlucky")
    if number == 14:
        raise OddError("fourteen", 14)
    return number**2


class OddError(Exception):
    def __init__(self, name: str, number: int) -> None:  # cannot be pickled: its arguments are not those of its base
        super().__init__(f"{name} is {number}")


def nothing_to_pickle(number: int) -> Callable[[], int]:
    return lambda: number


def surroundings(job: int) -> tuple[int, int, int, bool]:
    import cv2
    import numba

    interrupts_ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    return os.getpid(), numba.get_num_threads(), cv2.getNumThreads(), interrupts_ignored


def counter(start: int) -> Callable[[int], tuple[int, int]]:
    """Adds a job's number to a sum that lives as long as the process."""
    total = [start]

    def add(number: int) -> tuple[int, int]:
        total[0] += number
        return os.getpid(), total[0]

    return add


def impossible() -> Callable[[int], int]:
    raise SbmError("there is no such detector")


def write_for_ever(folder: Path) -> None:
    """Writes a folder that never gets done."""
    with atomic_folder(folder / str(os.getpid())) as temporary:
        (temporary / "half").write_text("")
        os.write(1, b"writing\n")  # in one go, so that lines of several processes do not mix
        while True:  # a signal that comes just before signal.pause() would be slept over
            time.sleep(0.05)


def fail_or_wait(job: tuple[Path, str]) -> None:
    """The first fails once the second has begun; the second ends once it may."""
    folder, name = job
    (folder / name).write_text("")
    _wait_for(folder / ("second" if name == "first" else "may end"))
    if name == "first":
        raise SbmError("the first failed")
    (folder / f"{name} done").write_text("")


def _wait_for(path: Path) -> None:
    deadline = time.monotonic() + 60
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.01)  # another process: its file is all there is to wait on


def square_and_be_told_to_end_while_ending(number: int) -> int:
    """The square; as the process ends, it gets the signal with which pools end workers."""
    weakref.finalize(square, os.kill, os.getpid(), signal.SIGTERM)
    return number**2
