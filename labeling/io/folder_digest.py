"""A digest of what lies in the folder of an episode: what is made of it is made anew when it has changed."""

import hashlib
from collections.abc import Collection
from pathlib import Path


def folder_digest(folder: Path, without: Collection[str] = ()) -> str:
    """Changes with the name and the content of any file in a folder or below; hidden ones do not count.

    Args:
        folder: of an episode.
        without: names of files that do not count.

    Raises:
        OSError: if a file cannot be read.
    """
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        relative = path.relative_to(folder)
        if not any(part.startswith(".") for part in relative.parts) and relative.name not in without:
            digest.update(str(relative).encode(errors="surrogateescape") + b"\0")
            with path.open("rb") as file:  # which may be larger than the memory
                digest.update(hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()
