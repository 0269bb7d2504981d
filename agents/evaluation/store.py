"""Results of episodes on disk: one JSON file for each policy, seed and episode."""

import hashlib
import json
from pathlib import Path
from typing import Any

from agents.evaluate import EvaluateConfig
from agents.policies.registry import checkpoint_of
from labeling.errors import UsageError
from labeling.files import write_json

SETTINGS_FILE = "settings.json"
DECISIVE = ("env", "split", "detector", "labels", "size")
"""Settings that decide what an episode's result is."""


def claim_folder(config: EvaluateConfig) -> None:
    """Notes the settings in the folder; refuses a folder that holds results of others, or something else.

    Raises:
        UsageError: if it does, or cannot be written to.
    """
    settings = {name: getattr(config, name) for name in DECISIVE}
    path = config.out / SETTINGS_FILE
    if path.is_file():
        before = read_result(path).get("settings", {})
        differing = [
            f"--{name} {before.get(name)!s} there, {value!s} now"
            for name, value in settings.items()
            if before.get(name) != value
        ]
        if differing:
            raise UsageError(
                f"{config.out} holds results of other settings ({'; '.join(differing)}); give another --out, or the "
                "same settings to go on"
            )
        return
    if config.out.exists() and not config.out.is_dir():
        raise UsageError(f"{config.out} is a file; --out is a folder for results")
    if config.out.is_dir() and any(config.out.iterdir()):
        raise UsageError(f"{config.out} is not empty and was not made by this program; give another --out")
    try:
        write_json(path, {"settings": settings})
    except OSError as error:
        raise UsageError(f"cannot write to {config.out}: {error.strerror}") from error


def policy_key(policy: str, env_id: str) -> str:
    """What a policy's results are kept under: its name, and for a trained one what its checkpoint holds.

    Raises:
        UsageError: if its checkpoint is missing.
    """
    checkpoint = checkpoint_of(policy, env_id)
    if checkpoint is None:
        return policy
    from agents.ppo.checkpoint import checkpoint_folder

    found = hashlib.sha256()
    for file in sorted(path for path in checkpoint_folder(checkpoint).iterdir() if path.is_file()):
        found.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return f"ppo-{found.hexdigest()[:12]}"


def result_path(out: Path, key: str, seed: int, episode: int) -> Path:
    """Where the result of an episode lies."""
    return out / "episodes" / key / f"seed{seed}-{episode:04d}.json"


def read_result(path: Path) -> dict[str, Any]:
    """What such a file holds.

    Raises:
        UsageError: if it is damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({error}); delete it to have it made again") from None
    if not isinstance(content, dict):
        raise UsageError(f"{path}: is not a result; delete it to have it made again")
    return content
