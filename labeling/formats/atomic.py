"""Writing files so that a killed process leaves either the old file or the new one, never half of one."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yields a temporary folder beside ``path`` that takes its place when the block ends without an error.

    An existing folder at ``path`` is replaced. Temporary names start with a dot, so that readers pass them over.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        temporary.chmod(0o755)
        yield temporary
        if path.exists():
            doomed = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent))
            path.replace(doomed / "old")
            temporary.replace(path)
            shutil.rmtree(doomed)
        else:
            temporary.replace(path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yields a temporary path beside ``path`` to write to; renamed to ``path`` when the block ends without an error."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


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
