"""Where a result comes from: versions of what computed it, and the commit of this code."""

import importlib.metadata
import subprocess
from collections.abc import Sequence
from pathlib import Path

PACKAGES = ("seeing-by-moving", "gymnasium", "mujoco", "numpy", "open3d", "stable-baselines3", "torch")


def versions(names: Sequence[str] = PACKAGES) -> dict[str, str | None]:
    """Installed versions of packages by name, None for those that are not installed."""
    found: dict[str, str | None] = {}
    for name in names:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found


def git_commit() -> str | None:
    """Commit of the checkout this code runs from, None if it is none."""
    return git("rev-parse", "HEAD")


def git(*arguments: str) -> str | None:
    """What git says in the checkout this code runs from, None if it is none."""
    try:
        result = subprocess.run(
            ["git", *arguments],
            cwd=Path(__file__).resolve().parents[2],
            capture_output=True,
            text=True,
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return result.stdout.strip() if result.returncode == 0 else None
