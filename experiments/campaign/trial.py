"""One command, run once on files that may be spoilt, and judged: does it end well, or say in one line what is wrong?"""

import contextlib
import gc
import io
import os
import signal
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

PATIENCE_S = 30
"""A command that takes longer on such small files hangs."""
MOST_MEMORY_MB = 2000
"""A command that takes more than this beyond what the process had is greedy."""
FINE = ("done", "refused")
OUTCOMES = (*FINE, "traceback", "hang", "memory", "outside", "half-written", "silent", "nonsense", "died")
"""How a command ends. ``done``: exit code 0, or 1 from a check; ``refused``: exit code 2 and one line that begins with
error. The others are faults: an exception that nobody caught, or a traceback; more than ``PATIENCE_S``; more than
``MOST_MEMORY_MB``; files outside the folder for results; temporary files left; exit code 2 without a word; results that
the project's own check finds fault with; a process that died."""


@dataclass(frozen=True)
class Trial:
    """How one run ended."""

    outcome: str
    """One of ``OUTCOMES``."""
    code: int | None
    """Exit code; None where there was none."""
    told: str
    """The last lines of what it said."""
    seconds: float
    memory_mb: float
    """Highest, beyond what the process had before."""


class _HangError(BaseException):
    """Raised by the alarm; nothing in the project catches it."""


def run_trial(
    module: str, arguments: list[str], folder: Path, out: Path, variables: dict[str, str] | None = None
) -> Trial:
    """Runs the ``main`` of a command in this process.

    Args:
        module: with the function ``main``.
        arguments: of the command line.
        folder: holds the inputs and ``out``, and nothing else may appear in it.
        out: where the command may write.
        variables: of the environment, set meanwhile.
    """
    before = _entries(folder, out)
    gc.collect()
    base_mb = _memory_mb(reset=True)
    said, code, broke = io.StringIO(), None, ""
    begun = time.monotonic()
    try:
        with (
            _alarm(),
            _environment(variables or {}),
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(said),
        ):
            code = import_module(module).main(arguments)
    except _HangError:
        broke = "hang"
        said.write(traceback.format_exc(limit=-3))
    except SystemExit as error:  # wrong usage, as argparse has it
        code = error.code if isinstance(error.code, int) else 2
        said.write("error: usage\n")
    except Exception:
        broke = "traceback"
        said.write(traceback.format_exc(limit=-4))
    seconds = time.monotonic() - begun
    memory_mb = max(_memory_mb() - base_mb, 0.0)
    told = said.getvalue()
    outcome = broke or _judged(code, told, folder, out, before, memory_mb)
    return Trial(outcome, code, told[-2000:], round(seconds, 2), round(memory_mb, 1))


def _judged(
    code: int | None, told: str, folder: Path, out: Path, before: set[tuple[str, int]], memory_mb: float
) -> str:
    if "Traceback" in told:
        return "traceback"
    if memory_mb > MOST_MEMORY_MB:
        return "memory"
    new = {name for name, _ in _entries(folder, out) - before}
    if any(_is_temporary(Path(name)) for name in new) or any(map(_is_temporary, out.rglob("*"))):
        return "half-written"
    if _entries(folder, out) != before:
        return "outside"
    if code == 2:
        return "refused" if any(line.startswith("error:") for line in told.splitlines()) else "silent"
    if code not in (0, 1):
        return "silent"
    return "nonsense" if code == 0 and _is_nonsense(out) else "done"


def _is_nonsense(out: Path) -> bool:
    """Whether the project's own check of label sets finds fault with one that was made without a word."""
    from labeling.core.errors import SbmError
    from labeling.inspection.checks import inspect_label_set

    if not (out / "label_set.json").is_file():
        return False
    try:
        return bool(inspect_label_set(out))
    except SbmError:
        return True


def _is_temporary(path: Path) -> bool:
    return path.name.startswith(".") or path.name.endswith(".tmp")


def _entries(folder: Path, out: Path) -> set[tuple[str, int]]:
    """Names and sizes of all files but those of ``out``."""
    found = set()
    for path in folder.rglob("*"):
        if path != out and out not in path.parents and not path.is_dir():
            with contextlib.suppress(OSError):
                found.add((path.relative_to(folder).as_posix(), path.lstat().st_size))
    return found


def _memory_mb(reset: bool = False) -> float:
    """The most memory that this process has had since the last reset."""
    if reset:
        Path("/proc/self/clear_refs").write_text("5")
    status = Path("/proc/self/status").read_text()
    return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))) / 1024


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    """Raises ``_HangError`` in the block after ``PATIENCE_S``."""

    def ring(*_: Any) -> None:
        raise _HangError

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(PATIENCE_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
