"""Names of files that are made of names of episodes."""

import hashlib

MAX_NAME_BYTES = 150
"""Longest name of an HTML file, without its ending; file systems take 255, and files being written have longer ones."""


def short_name(name: str) -> str:
    """A name that file systems take: what is longer than ``MAX_NAME_BYTES`` in UTF-8 ends with a digest of the rest."""
    coded = name.encode(errors="surrogateescape")
    if len(coded) <= MAX_NAME_BYTES:
        return name
    mark = f"_{hashlib.sha256(coded).hexdigest()[:12]}"
    return coded[: MAX_NAME_BYTES - len(mark)].decode(errors="ignore") + mark
