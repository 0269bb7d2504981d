"""Writing files so that a killed process leaves either the old file or the new one, never half of one.

What is being written has a hidden name beside its place. Such names tell the process that made them, and whoever writes
into the same folder next removes those of processes that are gone.
"""

import contextlib
import ctypes
import functools
import hashlib
import json
import os
import re
import shutil
import socket
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yields a temporary folder beside ``path`` that takes its place when the block ends without an error.

    An existing folder at ``path`` is exchanged for it in one step where the system can do that; elsewhere it is put
    aside first, and ``finish_replacing`` puts it back if the program was killed before the new one took its place.
    Temporary names start with a dot, so that readers pass them over.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    finish_replacing(path)
    _sweep_once(path.parent)
    temporary = Path(tempfile.mkdtemp(prefix=_prefix(path), dir=path.parent))
    try:
        temporary.chmod(0o755)
        yield temporary
        if not path.exists():
            temporary.replace(path)
        elif not _exchange(temporary, path):
            aside = _put_aside(path)
            path.replace(aside)
            temporary.replace(path)
            shutil.rmtree(aside)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def finish_replacing(path: Path) -> None:
    """Puts a folder back that was put aside to be replaced, if nothing has replaced it; else removes it.

    To be called before a folder is read that ``atomic_folder`` writes.
    """
    aside = _put_aside(path)
    if aside.is_dir() and path.exists():
        shutil.rmtree(aside, ignore_errors=True)
    elif aside.is_dir():
        aside.replace(path)


def _put_aside(path: Path) -> Path:
    """Where a folder is while another takes its place."""
    return path.with_name(f".{path.name}.replaced")


def _exchange(one: Path, other: Path) -> bool:
    """Exchanges two paths in one step; False if the system or the file system cannot do that."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    here = ctypes.c_int(_RELATIVE_TO_HERE)
    return rename(here, os.fsencode(one), here, os.fsencode(other), ctypes.c_uint(_RENAME_EXCHANGE)) == 0


_RELATIVE_TO_HERE, _RENAME_EXCHANGE = -100, 2
"""``AT_FDCWD`` and ``RENAME_EXCHANGE`` of Linux."""


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yields a temporary path beside ``path`` to write to; renamed to ``path`` when the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    _sweep_once(path.parent)
    temporary = path.with_name(f"{_prefix(path)}tmp")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _prefix(path: Path) -> str:
    """How the temporary names of a file or folder begin."""
    return f".{path.name}.{os.getpid()}-{_machine()}."


def is_half_written(path: Path) -> bool:
    """Whether a name is that of something that is being written, or that a killed process has left half written."""
    return _TEMPORARY.fullmatch(path.name) is not None


_TEMPORARY = re.compile(r"\..+\.(\d+)-([0-9a-f]{6})\.\w+")
_ABANDONED_S = 24 * 3600.0
"""Of other machines it is not known which processes are gone; what has not changed for so long is taken to be left."""
_SWEPT: set[Path] = set()
"""Folders that this process has looked through."""


def _sweep_once(folder: Path) -> None:
    """Removes what killed processes have left in a folder; does nothing the second time."""
    if folder in _SWEPT:
        return
    _SWEPT.add(folder)
    with contextlib.suppress(OSError):  # nothing to look through, or not for us
        for path in [Path(entry) for entry in os.scandir(folder) if entry.name.startswith(".")]:
            match = _TEMPORARY.fullmatch(path.name)
            if match is not None and _is_left(path, int(match.group(1)), match.group(2)):
                with contextlib.suppress(OSError):
                    shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def _is_left(path: Path, process: int, machine: str) -> bool:
    if machine != _machine():
        return time.time() - path.lstat().st_mtime > _ABANDONED_S
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except OSError:  # it is there, and somebody else's
        return False
    return False


@functools.cache
def _machine() -> str:
    """Changes from machine to machine, from start to start, and wherever numbers mean other processes."""
    about = [socket.gethostname()]
    with contextlib.suppress(OSError):
        about.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        about.append(str(Path("/proc/self/ns/pid").readlink()))
    return hashlib.sha256("\n".join(about).encode()).hexdigest()[:6]


def write_json(path: Path, content: Any) -> None:
    """Writes JSON atomically; refuses NaN and infinity, which are not JSON."""
    with atomic_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")


def write_records(path: Path, content: dict[str, Any]) -> None:
    """Writes JSON atomically, each entry of a list on a line of its own: many times as fast as ``write_json``."""
    fields = []
    for name, value in content.items():
        if isinstance(value, list) and value:
            lines = ",\n".join(json.dumps(one, allow_nan=False) for one in value)
            fields.append(f"{json.dumps(name)}: [\n{lines}\n]")
        else:
            fields.append(f"{json.dumps(name)}: {json.dumps(value, allow_nan=False)}")
    with atomic_file(path) as temporary:
        temporary.write_text("{\n" + ",\n".join(fields) + "\n}\n")


def write_png(path: Path, picture: "np.ndarray") -> None:
    """Writes a picture atomically: RGB, or one channel of 8 or 16 bits."""
    import cv2

    _, encoded = cv2.imencode(".png", picture[..., ::-1] if picture.ndim == 3 else picture)
    with atomic_file(path) as temporary:
        temporary.write_bytes(encoded.tobytes())
