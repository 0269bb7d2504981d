"""What processes of a cluster do in tests; they import it by name."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from labeling.core.errors import SbmError
from labeling.formats.atomic import write_json

PATIENCE_S = 120.0


def double(job: int) -> int:
    return 2 * job


def die_or_double(job: int) -> int:
    """Kills its process at 3, raises at 5."""
    if job == 3:
        os._exit(9)
    if job == 5:
        raise SbmError("5 is unlucky")
    return 2 * job


def meet(job: tuple[str, int, int]) -> tuple[int, int]:
    """Waits for other processes; returns its number and process. The folder is the same for all, since it is a name."""
    name, number, processes = job
    folder = Path(name)
    (folder / f"process-{os.getpid()}").touch()
    _wait(lambda: len(list(folder.glob("process-*"))) >= processes)
    return number, os.getpid()


def stay(job: tuple[str, int]) -> int:
    """Says that it has begun, and waits until it may end."""
    folder, number = Path(job[0]), job[1]
    (folder / f"begun-{number}-{os.getpid()}").touch()
    _wait((folder / "may end").exists)
    return number


@dataclass(frozen=True)
class Copier:
    """Writes what each input holds, and where it was read from."""

    out: Path
    word: Path
    """A file that all jobs read."""

    def copy(self, job: Path) -> str:
        text = f"{job.resolve().name}: {job.read_text()} {self.word.read_text()}"
        write_json(self.out / f"{job.stem}.json", {"text": text, "from": str(job)})
        if "bad" in job.name:
            raise SbmError(f"{job}: is bad")
        return f"{job}: {text}"


def digest_of_process() -> dict[str, str]:
    """Differs between processes, as libraries of nodes might."""
    return {"chairs.sh3f": str(os.getpid())}


def surroundings(job: int) -> tuple[int, int, int, str]:
    import cv2
    import numba

    return numba.get_num_threads(), cv2.getNumThreads(), os.getpid(), str(Path.cwd())


def _wait(condition) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline_s:
        time.sleep(0.02)


def find(picture: np.ndarray) -> list[tuple[str, float, np.ndarray]]:
    """A detector: what is darker than the mean is a chair."""
    return [("chair", 0.95, picture.mean(axis=2) < picture.mean())]
