"""What figures were measured with: versions, commit, machine."""

import os
import platform
from typing import Any

from agents.rollouts.provenance import git, git_commit
from agents.rollouts.provenance import versions as installed

VERSIONED = (
    *("seeing-by-moving", "gymnasium", "mujoco", "open3d", "numpy", "numba", "scipy", "scikit-learn"),
    *("opencv-python-headless", "hotcoco", "torch"),
)


def provenance() -> dict[str, Any]:
    """Versions, commit and machine; the commit is None outside a checkout."""
    changes = git("status", "--porcelain", "--untracked-files=normal", "--", "*.py")
    return {
        "versions": versions(),
        "git_commit": git_commit(),
        "git_uncommitted_changes": None if changes is None else bool(changes),
        "machine": {"processor": platform.machine(), "cpus": len(os.sched_getaffinity(0))},
    }


def versions() -> dict[str, str | None]:
    """Versions of Python and of the packages that figures may depend on."""
    return {"python": platform.python_version(), **installed(VERSIONED)}
