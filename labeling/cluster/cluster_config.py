"""Where jobs are done, and which files they need there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.core.errors import UsageError

Contents = dict[str, str]
"""Digests or versions by the name of what they are of."""

LOCAL = "local"


@dataclass(frozen=True)
class ClusterConfig:
    """Where jobs are done."""

    cluster: str = LOCAL
    """Where the work is done: "local" (processes of this machine), or a Ray cluster (extra 'cluster'): "auto" (the one
    that runs on this machine), "HOST:PORT" (one that this machine is a node of) or "ray://HOST:PORT" (from outside). On
    a cluster --workers (--processes of agents.train) counts the processes of all nodes together, and one worker stands
    for all cores. See docs/scale.md."""
    shared: Path | None = None
    """A folder that all nodes of the cluster share: files below it do not travel."""

    @property
    def is_local(self) -> bool:
        """Whether processes of this machine do the work."""
        return self.cluster == LOCAL

    def files_named(self, *names: str) -> list[Path]:
        """Files and folders that names of detectors or policies lead to ("onnx:FILE", "ppo:RUN", "RUN"), to travel.

        Raises:
            UsageError: if one is an absolute path, which leads elsewhere on machines without a shared disk.
        """
        found = []
        for name in names:
            parts = (name, name.partition(":")[2], name.rpartition(":")[2])
            paths = [Path(part) for part in dict.fromkeys(parts) if part and Path(part).exists()]
            if paths and paths[0].is_absolute() and not self.is_local and self.shared is None:
                raise UsageError(
                    f"{name}: with --cluster give its path as seen from the folder that the command is started in "
                    "(the name is part of what is written), or --shared"
                )
            found += paths[:1]
        return found


HERE = ClusterConfig()


def nothing(job: object) -> Sequence[Path]:
    """What jobs read that need no files."""
    return ()


@dataclass(frozen=True)
class JobFiles:
    """Files that jobs read and write; they travel to nodes that share no disk with this machine, and home."""

    out: Path
    """Folder that jobs write into."""
    reads: Callable[[Any], Sequence[Path]] = nothing
    """Files and folders that a job reads; what is not there is passed over."""
    common: Sequence[Path] = ()
    """Files and folders that all jobs read: they travel once to each process."""
    whole: bool = False
    """Whether each folder directly in ``out`` appears whole or not at all; otherwise each file does."""
    last: Sequence[str] = ()
    """Names of files that are written after all others of a job: they say that it is done."""


@dataclass(frozen=True)
class SameThere:
    """Something that must be the same on all nodes, besides code, libraries and weights."""

    name: str
    """Such as "furniture libraries"."""
    contents: Callable[[], Contents]
    """A function of a module, which finds it."""
