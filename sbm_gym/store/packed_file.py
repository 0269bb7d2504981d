"""Files that hold JSON and arrays, mapped into memory by all processes that read them, with a checksum."""

import contextlib
import json
import mmap
import os
import struct
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from labeling.formats.atomic import atomic_file

MAGIC = b"seeing by moving"
_HEADER = struct.Struct("<16sII")
"""Magic words, CRC-32 of everything after it, number of bytes of JSON."""
_CHECKED_FROM = 20
ALIGNMENT = 64
"""Arrays begin at multiples of this, bytes."""


class DamagedError(ValueError):
    """A file is truncated, malformed, or does not have its checksum."""


def write_packed(path: Path, content: Any, arrays: Sequence[np.ndarray]) -> None:
    """Writes a file atomically.

    Args:
        path: where; an earlier file is replaced, and processes that have mapped it keep its content.
        content: any value that JSON can hold.
        arrays: any number of them, C-contiguous.
    """
    places, end = [], 0
    for array in arrays:
        start = _aligned(end)
        places.append([array.dtype.str, list(array.shape), start])
        end = start + array.nbytes
    text = json.dumps({"content": content, "arrays": places, "bytes": end}, separators=(",", ":")).encode()
    first = _aligned(_HEADER.size + len(text))
    parts: list[Any] = [struct.pack("<I", len(text)), text, bytes(first - _HEADER.size - len(text))]
    at = 0
    for array, (_, _, start) in zip(arrays, places, strict=True):
        parts += [bytes(start - at), array.reshape(-1).view(np.uint8)]
        at = start + array.nbytes
    checksum = 0
    for part in parts:
        checksum = zlib.crc32(part, checksum)
    with atomic_file(path) as temporary, temporary.open("wb") as file:
        file.write(_HEADER.pack(MAGIC, checksum, len(text))[:_CHECKED_FROM])
        for part in parts:
            file.write(part)


def read_packed(path: Path) -> tuple[Any, list[np.ndarray]]:
    """Reads the content and the arrays of a file; arrays are the mapped file (copied where they are written to).

    The whole file is read once in each process to check it.

    Raises:
        OSError: if there is no such file.
        DamagedError: if it is damaged.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        if status.st_size < _HEADER.size:
            raise DamagedError(f"{path} ends early")
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    magic, checksum, length = _HEADER.unpack_from(memory)
    if magic != MAGIC:
        raise DamagedError(f"{path} does not begin as it should")
    check(memory, _CHECKED_FROM, status.st_size, checksum, status, path)
    try:
        record = json.loads(memory[_HEADER.size : _HEADER.size + length])
        first = _aligned(_HEADER.size + length)
        arrays = [
            np.frombuffer(memory, np.dtype(kind), int(np.prod(shape, dtype=np.int64)), first + start).reshape(shape)
            for kind, shape, start in record["arrays"]
        ]
        return record["content"], arrays
    except (ValueError, KeyError, TypeError) as error:
        raise DamagedError(f"{path} is malformed ({error})") from error


def read_content(path: Path) -> Any:
    """Reads the content of a file without its arrays and without checking the checksum.

    Raises:
        OSError: if there is no such file.
        DamagedError: if it cannot be read.
    """
    with path.open("rb") as file:
        try:
            magic, _, length = _HEADER.unpack(file.read(_HEADER.size))
            if magic != MAGIC:
                raise DamagedError(f"{path} does not begin as it should")
            return json.loads(file.read(length))["content"]
        except (ValueError, KeyError, TypeError, struct.error) as error:
            raise DamagedError(f"{path} is malformed ({error})") from error


_checked: set[tuple[int, ...]] = set()
"""Files that this process has checked: device, inode, time of change, size and checksum. Files are replaced, never
changed; without the time, a new file in the place of one that is gone would count as checked."""


def check(
    memory: mmap.mmap, start: int, stop: int, checksum: int, status: os.stat_result, path: Path, mapped: bool = True
) -> None:
    """Checks the checksum of bytes of a file, once in each process.

    Args:
        memory: holds the bytes.
        start: index of the first byte.
        stop: one past the last byte.
        checksum: their CRC-32.
        status: of the file.
        path: of the file, for error messages.
        mapped: whether ``memory`` is the mapped file, not a copy.

    Raises:
        DamagedError: if the checksum differs.
    """
    key = (status.st_dev, status.st_ino, status.st_ctime_ns, status.st_size, checksum)
    if key in _checked:
        return
    with memoryview(memory) as whole, whole[start:stop] as part:
        if zlib.crc32(part) != checksum:
            raise DamagedError(f"{path} is not what was written: its checksum is another")
    _checked.add(key)
    # Gives pages that were read only for the check back to the system.
    if mapped and hasattr(mmap, "MADV_DONTNEED"):
        page = mmap.PAGESIZE
        with contextlib.suppress(OSError, ValueError):
            memory.madvise(mmap.MADV_DONTNEED, start // page * page, stop - start // page * page)


def _aligned(position: int) -> int:
    return -(-position // ALIGNMENT) * ALIGNMENT
