"""Texels of textures: one file for each texture, shared by all scenes, mapped next to each other as one array."""

import contextlib
import ctypes
import functools
import hashlib
import mmap
import os
import sys
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Int64, UInt8

from labeling.formats.atomic import atomic_file
from sbm_gym.store.packed_file import DamagedError, check

TEXEL_BYTES = 4


@dataclass(frozen=True)
class TexelFile:
    """A texture with all its mip levels."""

    name: str
    """Name of its file: a digest of the content."""
    texels: int
    checksum: int


def save_texels(folder: Path, texels: UInt8[np.ndarray, "n 4"]) -> TexelFile:
    """Writes the file of a texture, unless it exists."""
    content = np.ascontiguousarray(texels).data.cast("B")
    name = hashlib.blake2b(content, digest_size=16).hexdigest()
    path = folder / name
    if path.is_file() and path.stat().st_size == _padded(content.nbytes):
        # ``SceneFolder.shrink`` keeps files that were used recently.
        os.utime(path)
    else:
        with atomic_file(path) as temporary, temporary.open("wb") as file:
            file.write(content)
            file.write(bytes(_padded(content.nbytes) - content.nbytes))
    return TexelFile(name, len(texels), zlib.crc32(content))


def open_texels(
    folder: Path, files: Sequence[TexelFile]
) -> tuple[UInt8[np.ndarray, "n 4"], Int64[np.ndarray, "textures"]]:
    """Texels of several textures as one array, and the index at which each begins.

    On Linux the array consists of the mapped files, whose memory all processes share.

    Raises:
        OSError: if a file is missing.
        DamagedError: if one is damaged; it is removed, so that it will be written again.
    """
    sizes = np.array([_padded(TEXEL_BYTES * file.texels) for file in files], np.int64)
    starts = np.cumsum(sizes) - sizes
    memory = mmap.mmap(-1, int(sizes.sum()))
    for file, start, size in zip(files, starts.tolist(), sizes.tolist(), strict=True):
        path = folder / file.name
        try:
            with path.open("rb") as opened:
                status = os.fstat(opened.fileno())
                if status.st_size != size:
                    raise DamagedError(f"{path} is not as long as it was")
                mapped = _map_file(memory, start, size, opened.fileno())
                if not mapped:
                    memory[start : start + size] = opened.read(size)
            check(memory, start, start + TEXEL_BYTES * file.texels, file.checksum, status, path, mapped)
        except DamagedError:
            with contextlib.suppress(OSError):
                path.unlink()
            raise
    return np.frombuffer(memory, np.uint8).reshape(-1, TEXEL_BYTES), starts // TEXEL_BYTES


def _map_file(memory: mmap.mmap, start: int, size: int, descriptor: int) -> bool:
    """Maps a file over a part of anonymous memory; returns whether that could be done."""
    function = _mmap_function()
    if function is None:
        return False
    address = ctypes.addressof(ctypes.c_char.from_buffer(memory)) + start
    access, kind = mmap.PROT_READ | mmap.PROT_WRITE, mmap.MAP_PRIVATE | _MAP_FIXED
    return function(address, size, access, kind, descriptor, 0) == address


_MAP_FIXED = 0x10


@functools.cache
def _mmap_function() -> Callable[..., int | None] | None:
    if sys.platform != "linux":
        return None
    function = ctypes.CDLL(None, use_errno=True).mmap
    function.restype = ctypes.c_void_p
    function.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    return function


def _padded(size: int) -> int:
    """A size rounded up to whole pages, so that files can be mapped next to each other."""
    return max(-(-size // mmap.ALLOCATIONGRANULARITY), 1) * mmap.ALLOCATIONGRANULARITY
