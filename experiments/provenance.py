"""What figures were measured with: versions, commit, machine."""

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

VERSIONED = (
    *("seeing-by-moving", "gymnasium", "mujoco", "open3d", "numpy", "numba", "scipy", "scikit-learn"),
    *("opencv-python-headless", "hotcoco", "torch"),
)


def provenance() -> dict[str, Any]:
    """Versions, commit and machine; the commit is None outside a checkout."""
    changes = _git("status", "--porcelain", "--untracked-files=normal", "--", "*.py")
    return {
        "versions": versions(),
        "git_commit": _git("rev-parse", "HEAD"),
        "git_uncommitted_changes": None if changes is None else bool(changes),
        "machine": {"processor": platform.machine(), "cpus": len(os.sched_getaffinity(0))},
    }


def versions() -> dict[str, str | None]:
    """Versions of Python and of the packages that figures may depend on."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in VERSIONED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found


def _git(*arguments: str) -> str | None:
    try:
        result = subprocess.run(
            ["git", *arguments],
            cwd=Path(__file__).resolve().parents[1],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except OSError:
        return None
    return result.stdout.strip() if result.returncode == 0 else None
