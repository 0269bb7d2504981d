"""What a process on a node of a cluster does. It imports nothing heavy before its first job."""

import contextlib
import os
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.cluster.cluster_config import Contents, SameThere
from labeling.cluster.same_code import contents_here, differences
from labeling.cluster.travel import dumps, loads, outputs, state_of, unpack
from labeling.runtime.process_pool import function_of, sendable
from labeling.runtime.provenance import COMMIT_VARIABLE
from labeling.runtime.threads import THREAD_VARIABLES

_PREFIX = "sbm-worker-"


@dataclass(frozen=True)
class Orders:
    """What is the same for all jobs."""

    work: bytes
    """Does the jobs, as ``dumps`` has pickled it."""
    folder: str
    """That the command was started in."""
    packages: tuple[str, ...]
    """Of the project, that must be the same."""
    more: Sequence[SameThere]
    """What else must be the same."""
    contents: dict[str, Contents]
    """What they are on the machine that the jobs come from."""
    out: str | None
    """Folder for results, if they travel home."""
    last: Sequence[str]
    """Names of result files that are written last."""
    commit: str
    """Of the code on the machine that the jobs come from; empty for none."""
    shared: str | None
    """A file on the shared disk; None if there is no shared disk."""


class Worker:
    """Does one job at a time."""

    def __init__(self, threads: int = 1) -> None:
        """Before anything heavy is imported.

        Args:
            threads: that compute side by side.
        """
        os.environ.update(dict.fromkeys((*THREAD_VARIABLES, "OPENCV_FOR_THREADS_NUM"), str(threads)))
        # The folder of a program's file is among these, and where the program is one of a package it must not be:
        # modules there have names of the standard library's.
        sys.path[:] = [path for path in sys.path if not Path(path or ".", "__init__.py").is_file()]

    def begin(self, orders: Orders, common: bytes | None) -> list[str]:
        """Gets ready for jobs.

        Args:
            orders: what is the same for all jobs.
            common: files that all of them need.

        Returns:
            What is not as on the machine that the jobs come from, in words; empty if all is well.
        """
        problems = differences(orders.contents, contents_here(orders.packages, orders.more))
        if orders.shared is not None:
            for place in (orders.shared, orders.folder):
                if not Path(place).exists():
                    problems.append(f"the shared disk: {place} is not there")
        if problems:
            return problems
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.environ[COMMIT_VARIABLE] = orders.commit
        self._orders = orders
        self._root = "" if orders.shared is not None else _new_root()
        folder = Path(self._root + orders.folder)
        folder.mkdir(parents=True, exist_ok=True)
        os.chdir(folder)
        if common is not None:
            unpack(common, self._root)
        self._do: Callable[[Any], Any] = function_of(loads(orders.work, self._root))
        return []

    def do(self, job: bytes, files: bytes | None) -> bytes:
        """Does a job.

        Args:
            job: as ``dumps`` has pickled it.
            files: that it reads.

        Returns:
            Pickled: its result, what it has raised, and the files it has written.
        """
        written = unpack(files, self._root) if files is not None else []
        out = Path(self._root + self._orders.out) if self._orders.out is not None else None
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
        before = state_of(out) if out is not None else {}
        try:
            value, error = self._do(loads(job, self._root)), None
            answer = value, None, outputs(out, before, self._root, self._orders.last) if out is not None else []
            return dumps(answer, self._root)
        except Exception as error:  # judged by whoever gave the job
            return dumps((None, sendable(error), []), self._root)
        finally:
            for path in written:
                path.unlink(missing_ok=True)
            if out is not None:
                for path in state_of(out):
                    if path not in before:
                        path.unlink(missing_ok=True)


def _new_root() -> str:
    """A folder that stands for the root of the other machine's disk; removes those of processes that have died."""
    for path in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        found = re.fullmatch(rf"{_PREFIX}(\d+)-.*", path.name)
        if found and not Path("/proc", found[1]).exists():
            with contextlib.suppress(OSError):
                shutil.rmtree(path)
    return str(Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-")).resolve())
