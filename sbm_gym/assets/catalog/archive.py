"""Reading members of zip archives that strangers made: bounded sizes, no way out of the archive."""

import hashlib
import io
import posixpath
import zipfile
from pathlib import Path

from labeling.core.errors import SbmError

MAX_MEMBER_BYTES = 64 * 1024 * 1024
"""Largest file read from an archive; the largest model of the Debian libraries has 9 MB."""
MAX_MEMBERS = 100_000


class ArchiveError(SbmError, ValueError):
    """A furniture library is damaged, or asks for something that an archive must not ask for."""


class FurnitureArchive:
    """A zip archive read member by member. Nothing is ever unpacked to a path that the archive names."""

    def __init__(self, source: Path | bytes, name: str):
        """Opens the archive.

        Args:
            source: the file, or its content (for an archive within an archive).
            name: how errors call it.

        Raises:
            ArchiveError: if it is not a zip file or has too many members.
        """
        self.name = name
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
        except Exception as error:  # of zipfile, struct, names that are no text
            raise ArchiveError(f"{name}: not a readable zip archive ({error})") from None
        members = self._zip.infolist()
        if len(members) > MAX_MEMBERS:
            raise ArchiveError(f"{name}: holds {len(members)} files, more than {MAX_MEMBERS}; refused")
        self._members = {member.filename: member for member in members}
        self._folded = {member.filename.lower(): member for member in members}

    def __enter__(self) -> "FurnitureArchive":
        return self

    def __exit__(self, *exception: object) -> None:
        self._zip.close()

    def names(self) -> list[str]:
        """All member names, in the archive's order."""
        return list(self._members)

    def content_hash(self) -> str:
        """Identifies the content by names, sizes and checksums of all members, without reading them."""
        digest = hashlib.sha256()
        for name, member in sorted(self._members.items()):
            digest.update(f"{name}\0{member.file_size}\0{member.CRC}\n".encode())
        return digest.hexdigest()[:16]

    def has(self, path: str) -> bool:
        """Whether there is such a member (letter case aside)."""
        return path in self._members or path.lower() in self._folded

    def read(self, path: str) -> bytes:
        """Content of a member.

        Args:
            path: name as in the archive; letter case may differ, as on the systems these libraries come from.

        Raises:
            ArchiveError: if the path leads out of the archive, does not exist, or the member is too large.
        """
        path = resolve(path, self.name)
        member = self._members.get(path) or self._folded.get(path.lower())
        if member is None:
            raise ArchiveError(f"{self.name}: has no file {path!r}")
        if member.file_size > MAX_MEMBER_BYTES:
            raise ArchiveError(
                f"{self.name}: {path!r} unpacks to {member.file_size} bytes, more than {MAX_MEMBER_BYTES}; refused"
            )
        try:
            with self._zip.open(member) as file:
                content = file.read(MAX_MEMBER_BYTES + 1)  # the header may lie about the size
        except Exception as error:  # of zipfile, zlib, bz2, lzma, names that are no text
            raise ArchiveError(f"{self.name}: {path!r} cannot be read ({error})") from None
        if len(content) > MAX_MEMBER_BYTES:
            raise ArchiveError(f"{self.name}: {path!r} unpacks to more than {MAX_MEMBER_BYTES} bytes; refused")
        return content


def resolve(path: str, archive_name: str, folder: str = "") -> str:
    """A member name from a path that a file in the archive gives.

    Args:
        path: the path; one leading slash means the root of the archive.
        archive_name: how errors call the archive.
        folder: where relative paths start.

    Raises:
        ArchiveError: if the path leads out of the archive.
    """
    forward = path.replace("\\", "/")
    joined = posixpath.normpath(forward[1:] if forward.startswith("/") else posixpath.join(folder, forward))
    if (
        joined.startswith(("../", "/"))
        or joined in ("..", ".")
        or ":" in joined.split("/", maxsplit=1)[0]
        or "\0" in joined
    ):
        raise ArchiveError(f"{archive_name}: the path {path!r} leads out of the archive; refused")
    return joined
