"""Commands as processes of their own, and what they leave: to be killed, starved of disk, run twice at once."""

import contextlib
import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

PATIENCE_S = 300
"""A command that takes longer than this hangs; undisturbed they take a few seconds."""


@dataclass(frozen=True)
class Ended:
    """How a process ended."""

    code: int | None
    """None if it had to be ended because it did not."""
    told: str
    """What it said on stderr."""
    seconds: float


def start(module: str, arguments: Sequence[str], environment: dict[str, str] | None = None) -> "subprocess.Popen[str]":
    """Starts ``python -m module``, with a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **(environment or {})},
        start_new_session=True,
    )


def wait(process: "subprocess.Popen[str]", patience_s: float = PATIENCE_S) -> Ended:
    """Waits for the end of a process; ends it, with its children, when patience does."""
    begun = time.monotonic()
    try:
        _, told = process.communicate(timeout=patience_s)
    except subprocess.TimeoutExpired:
        kill(process)
        _, told = process.communicate()
        return Ended(None, told, time.monotonic() - begun)
    except BaseException:  # told to stop: no process of a group of its own is left behind
        kill(process)
        raise
    return Ended(process.returncode, told, time.monotonic() - begun)


def kill(process: "subprocess.Popen[str]", number: int = signal.SIGKILL) -> None:
    """Sends a signal to a process and all that it has started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, number)


def tree_digest(folder: Path) -> dict[str, str]:
    """Digests of all files below a folder, by name; hidden ones too."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def leftovers(folder: Path) -> list[str]:
    """Temporary files and folders beside and below a place for results."""
    found = [path for path in folder.parent.rglob("*") if path.name.startswith(".") or path.name.endswith(".tmp")]
    return sorted(path.relative_to(folder.parent).as_posix() for path in found)
