"""Whether machines that make the same worlds have the same furniture libraries."""

import functools
import hashlib
from pathlib import Path

from labeling.cluster.cluster_config import Contents, SameThere
from labeling.core.errors import MissingAssetsError
from sbm_gym.assets.catalog.catalog import find_libraries


def same_libraries(worlds: object) -> tuple[SameThere, ...]:
    """What nodes of a cluster must have in common to build these worlds.

    Args:
        worlds: name of a kind of worlds, or what makes them.
    """
    builtin = worlds.endswith("-builtin") if isinstance(worlds, str) else getattr(worlds, "builtin", False)
    return () if builtin else (SameThere("furniture libraries", library_digests),)


def library_digests() -> Contents:
    """Digests of the installed furniture libraries by their names; none if there are none."""
    try:
        found = find_libraries()
    except MissingAssetsError:
        return {}
    return {path.name: _digest(path, path.stat().st_mtime_ns) for path in found}


@functools.cache
def _digest(path: Path, changed_ns: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
