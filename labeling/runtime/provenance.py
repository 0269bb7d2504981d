"""Where a result comes from: versions of what computed it, the commit of this code, the machine."""

import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

SIMULATION_PACKAGES = ("seeing-by-moving", "gymnasium", "mujoco", "numpy", "embreex", "stable-baselines3", "torch")
"""What rollouts and trained policies depend on."""
EXPERIMENT_PACKAGES = (
    *("seeing-by-moving", "gymnasium", "mujoco", "embreex", "numpy", "numba", "scipy", "scikit-learn"),
    *("opencv-python-headless", "hotcoco", "torch"),
)
"""What figures of experiments may depend on, beside Python."""


def package_versions(names: Sequence[str]) -> dict[str, str | None]:
    """Installed versions of packages by name, None for those that are not installed."""
    return {name: _version(name) for name in names}


@cache
def _version(name: str) -> str | None:
    """What is asked once: reading a package's metadata takes a millisecond."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def simulation_provenance() -> dict[str, Any]:
    """Versions and commit that a rollout or a trained policy comes from."""
    return {"versions": package_versions(SIMULATION_PACKAGES), "git_commit": git_commit()}


def experiment_versions() -> dict[str, str | None]:
    """Versions of Python and of the packages that figures may depend on."""
    return {"python": platform.python_version(), **package_versions(EXPERIMENT_PACKAGES)}


SOURCES = ("*.py", "*.toml", "*.yaml", "*.safetensors", "labeling/*.json", "sbm_gym/*.json", "agents/*.json")
"""Files of the checkout whose changes may change figures: code, settings, weights, calibrations. ``*`` crosses folders.
Results are none: one experiment writes them while the next runs."""


def experiment_provenance() -> dict[str, Any]:
    """Versions, commit and machine that figures were measured with; the commit is None outside a checkout."""
    changes = _git("status", "--porcelain", "--untracked-files=normal", "--", *(f":(top){files}" for files in SOURCES))
    return {
        "versions": experiment_versions(),
        "git_commit": git_commit(),
        "git_uncommitted_changes": None if changes is None else bool(changes),
        "machine": {"processor": platform.machine(), "cpus": len(os.sched_getaffinity(0))},
    }


COMMIT_VARIABLE = "SBM_GIT_COMMIT"
"""Environment variable by which a process on another machine learns the commit of the same code; empty for none."""


def git_commit() -> str | None:
    """Commit of the checkout this code runs from, None if it is none."""
    told = os.environ.get(COMMIT_VARIABLE)
    if told is not None:
        return told or None
    return _git("rev-parse", "HEAD")


def _git(*arguments: str) -> str | None:
    try:
        result = subprocess.run(
            ["git", *arguments],
            cwd=Path(__file__).resolve().parent,
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return result.stdout.strip() if result.returncode == 0 else None
