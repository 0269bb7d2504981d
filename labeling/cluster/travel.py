"""Paths and files on their way to machines that share no disk with this one, and home.

A node keeps what it is sent in a folder that stands for the root of the other machine's disk: paths that are relative
stay as they are, since its processes work in the folder that stands for the one that the command was started in; paths
that are absolute get another beginning, and lose it on the way home.
"""

import importlib
import io
import os
import pickle
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePath
from types import FunctionType
from typing import Any

from labeling.core.errors import UsageError
from labeling.formats.atomic import atomic_file, atomic_folder

Outputs = list[tuple[str, bytes]]
"""Files that a job has written: where, relative to the folder for all results, and what."""


def dumps(value: Any, root: str = "") -> bytes:
    """Pickles for another machine.

    Args:
        value: functions and classes must be those of modules.
        root: the folder that stands for the other machine's disk; empty if this is that machine.

    Raises:
        UsageError: if something of a program that is no module is to be sent.
    """
    file = io.BytesIO()
    _Pickler(file, root).dump(value)
    return file.getvalue()


def loads(data: bytes, root: str = "") -> Any:
    """What ``dumps`` has pickled on another machine, with paths that lead to the same files here."""
    return _Unpickler(io.BytesIO(data), root).load()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, root: str) -> None:
        super().__init__(file, protocol=5)
        self._root = root

    def persistent_id(self, obj: Any) -> tuple[str, ...] | None:
        if isinstance(obj, PurePath) and obj.is_absolute():
            return "path", str(obj).removeprefix(self._root) or "/"
        if self._root and isinstance(obj, str) and self._root in obj:
            return "text", obj.replace(self._root, "")
        if isinstance(obj, FunctionType | type) and obj.__module__ == "__main__":
            spec = getattr(sys.modules["__main__"], "__spec__", None)
            if spec is None:
                raise UsageError(f"{obj.__qualname__}: is defined in a program; other machines need it in a module")
            return "named", spec.name, obj.__qualname__
        return None


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, root: str) -> None:
        super().__init__(file)
        self._root = root

    def persistent_load(self, pid: tuple[str, ...]) -> Any:
        kind, *content = pid
        if kind == "path":
            return Path(self._root + content[0])
        if kind == "text":
            return content[0]
        found: Any = importlib.import_module(content[0])
        for name in content[1].split("."):
            found = getattr(found, name)
        return found


def absolute(path: Path | str) -> str:
    """An absolute path without ``..``; links in it stay."""
    return os.path.abspath(path)  # noqa: PTH100 - Path.absolute keeps "..", Path.resolve does not keep links


def num_bytes(paths: Sequence[Path]) -> int:
    """Size of files and folders, without reading them."""
    return sum(Path(file).stat().st_size for file, kind in _entries(paths) if kind == "file")


def pack(paths: Sequence[Path]) -> bytes:
    """Files and folders, to be unpacked elsewhere; hidden ones in folders are left out.

    Raises:
        OSError: if one cannot be read.
    """
    packed: list[tuple[str, str, bytes | str]] = []
    for path, kind in _entries(paths):
        packed.append((path, kind, Path(path).read_bytes() if kind == "file" else str(Path(path).resolve())))
    return pickle.dumps(packed, protocol=5)


def _entries(paths: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Absolute paths of all files and folders, each with its kind; of a link first that, then what it leads to.

    Of ``labels/../episodes/000.png`` the folder ``labels``, too: without it the path leads nowhere.
    """
    passed: set[str] = set()
    for given in paths:
        path = Path(absolute(given))
        on_the_way = {absolute(Path(*given.parts[:place])) for place, part in enumerate(given.parts) if part == ".."}
        yield from ((folder, "folder") for folder in sorted(on_the_way - passed))
        passed |= on_the_way
        if path.is_symlink():
            yield str(path), "link"
            path = path.resolve()
        if path.is_file():
            yield str(path), "file"
        elif path.is_dir():
            for folder, below, names in os.walk(path, followlinks=True):
                below[:] = sorted(name for name in below if not name.startswith("."))
                yield folder, "folder"
                files = (Path(folder, name) for name in sorted(names) if not name.startswith("."))
                yield from ((str(file), "file") for file in files if file.is_file())


def unpack(data: bytes, root: str) -> list[Path]:
    """Writes what ``pack`` has packed below the folder that stands for the other machine's disk.

    Returns:
        The files and links.
    """
    written = []
    for path, kind, content in pickle.loads(data):
        place = Path(root + path)
        if kind == "folder":
            place.mkdir(parents=True, exist_ok=True)
            continue
        place.parent.mkdir(parents=True, exist_ok=True)
        if kind == "file":
            place.write_bytes(content)
        elif not place.is_symlink():
            place.symlink_to(root + content)
        written.append(place)
    return written


State = dict[Path, tuple[int, int, int]]
"""Files of a folder with what changes when they do."""


def state_of(folder: Path) -> State:
    """The files of a folder as they are now, hidden ones left out."""
    found = {}
    for path in folder.rglob("*"):
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(folder).parts):
            status = path.stat()
            found[path] = status.st_mtime_ns, status.st_ino, status.st_size
    return found


def outputs(folder: Path, before: State, root: str, last: Sequence[str]) -> Outputs:
    """What was written into a folder since its state was taken, in the order of writing.

    Args:
        folder: for all results.
        before: its state then.
        root: the folder that stands for the other machine's disk, which JSON files must not name.
        last: names of files that come after all others.
    """
    now = state_of(folder)
    changed = [path for path, state in now.items() if before.get(path) != state]
    changed.sort(key=lambda path: (path.name in last, now[path][0], path))
    return [(path.relative_to(folder).as_posix(), _without(path, root)) for path in changed]


def _without(path: Path, root: str) -> bytes:
    content = path.read_bytes()
    return content.replace(root.encode(), b"") if root and path.suffix == ".json" else content


def bring_home(folder: Path, files: Outputs, whole: bool) -> None:
    """Writes what a job has written elsewhere; each file, or each folder in the folder, appears whole or not at all.

    Raises:
        OSError: if that cannot be written.
    """
    if not whole:
        for name, content in files:
            with atomic_file(_below(folder, name)) as temporary:
                temporary.write_bytes(content)
        return
    folders: dict[str, Outputs] = {}
    for name, content in files:
        first, _, rest = name.partition("/")
        folders.setdefault(first, []).append((rest, content))
    for first, contents in folders.items():
        with atomic_folder(_below(folder, first)) as temporary:
            for name, content in contents:
                path = _below(temporary, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)


def _below(folder: Path, name: str) -> Path:
    """A path in a folder; what comes from elsewhere leads nowhere else."""
    path = PurePath(name)
    if path.is_absolute() or ".." in path.parts or not name:
        raise UsageError(f"a node of the cluster has sent a file called {name!r}, outside of its folder")
    return folder / path
