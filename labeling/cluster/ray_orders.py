"""What processes on nodes of a cluster are told first."""

import contextlib
import secrets
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from labeling.cluster.cluster_config import ClusterConfig, JobFiles, SameThere
from labeling.cluster.ray_worker import Orders
from labeling.cluster.same_code import contents_here, packages_up_to
from labeling.cluster.travel import absolute, dumps
from labeling.core.errors import UsageError
from labeling.runtime.process_pool import PerProcess
from labeling.runtime.provenance import git_commit


@contextlib.contextmanager
def orders_for(
    work: Any, module: str, where: ClusterConfig, more: Sequence[SameThere] = (), files: JobFiles | None = None
) -> Iterator[Orders]:
    """What processes are told first; good until the end of the block.

    Args:
        work: what they do with a job; see ``labeling.runtime.process_pool.run_jobs``.
        module: whose code, and that below it, must be the same on all nodes.
        where: the cluster.
        more: what else must be the same.
        files: that jobs read and write.

    Raises:
        UsageError: if something cannot be sent, or does not lie on the shared disk.
    """
    shared, folder, packages = where.shared, str(Path.cwd()), packages_up_to(module)
    with contextlib.ExitStack() as stack:
        marker = None
        if shared is not None:
            for path in (Path(folder), *((files.out, *files.common) if files else ())):
                if not Path(absolute(path)).is_relative_to(absolute(shared)):
                    raise UsageError(f"--shared {shared}: {path} does not lie below it, so that nodes cannot see it")
            marker = Path(absolute(shared)) / f".sbm-shared-{secrets.token_hex(8)}"
            marker.touch()
            stack.callback(marker.unlink, missing_ok=True)
        yield Orders(
            dumps(work),
            folder,
            packages,
            tuple(more),
            contents_here(packages, more),
            absolute(files.out) if files and shared is None else None,
            files.last if files else (),
            git_commit() or "",
            None if marker is None else str(marker),
        )


def module_of(work: Any) -> str:
    """The module of the function that does the work, or of the object that it is a method of."""
    while True:
        if isinstance(work, PerProcess):
            work = work.make
        elif hasattr(work, "func"):  # of functools.partial
            work = work.func
        else:
            break
    owner = getattr(work, "__self__", None)
    module = type(owner).__module__ if owner is not None else getattr(work, "__module__", type(work).__module__)
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    return spec.name if module == "__main__" and spec is not None else module or ""
