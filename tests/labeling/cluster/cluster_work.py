"""What processes of a cluster do in tests; they import it by name."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

from labeling.core.errors import SbmError
from labeling.formats.atomic import write_json


def pid_of(job: int) -> tuple[int, int]:
    return job, os.getpid()


def double(job: int) -> int:
    return 2 * job


def die_or_double(job: int) -> int:
    """Kills its process at 3, raises at 5."""
    if job == 3:
        os._exit(9)
    if job == 5:
        raise SbmError("5 is unlucky")
    return 2 * job


@dataclass(frozen=True)
class Copier:
    """Writes the content of each input, and where it was read from."""

    out: Path
    word: Path
    """A file that all jobs read."""

    def copy(self, job: Path) -> str:
        text = f"{job.read_text()} {self.word.read_text()}"
        write_json(self.out / f"{job.stem}.json", {"text": text, "from": str(job)})
        return f"{job}: {text}"


def meet(job: tuple[Path, int]) -> tuple[int, int]:
    """Says who has begun, then takes a while."""
    folder, number = job
    (folder / f"{number}-{os.getpid()}-{os.environ.get('RAY_NODE_OF_TEST', '')}").touch()
    time.sleep(1.0)
    return number, os.getpid()


def digest_of_node() -> dict[str, str]:
    """Differs between processes, as libraries of nodes might."""
    return {"chairs.sh3f": str(os.getpid())}
