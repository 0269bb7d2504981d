"""Where trained policies come from: what their checkpoints say, and the command that trains them again."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from agents.ppo.config import KeptOptions, PpoConfig
from agents.ppo.hyperparameters import SHIPPED_FILE, read_hyperparameters
from labeling.core.errors import UsageError

SHAPES = ("format", "observation_space", "action_space", "policy")
"""What a checkpoint says about its tensors, which is long and tells nothing of where they come from."""
NAMED_ALWAYS = ("env", "steps", "seed")
NOT_NAMED = ("out", "device", "resume")


def origin_of(checkpoint: Path) -> dict[str, Any]:
    """Where the weights of a checkpoint come from.

    Args:
        checkpoint: its folder, or that of a run, or the shipped one of an env.

    Returns:
        All that the checkpoint says of its training (``seed``, ``steps``, ``hyperparameters``, ``git_commit``, ...),
        and ``command``, which trains it again.

    Raises:
        SbmError: if there is no checkpoint or it is damaged.
    """
    from agents.network.checkpoint import checkpoint_folder, read_description

    description = read_description(checkpoint_folder(checkpoint))
    return {
        **{name: value for name, value in description.items() if name not in SHAPES},
        "command": training_command(description),
    }


def training_command(description: Mapping[str, Any]) -> str:
    """The command that trains a policy again, with whatever differs from the defaults.

    Args:
        description: of a checkpoint, or the settings that a run keeps; the names of both are those of ``PpoConfig``.
    """
    hyperparameters = description.get("hyperparameters", {})
    validation = description.get("validation") or {}
    known = {
        "eval_episodes": validation.get("episodes"),
        **description,
        "steps": hyperparameters.get("n_timesteps"),
        "envs": hyperparameters.get("n_envs"),
        "hyperparams": _shipped_file(str(description.get("env")), hyperparameters),
    }
    words = ["python", "-m", "agents.train"]
    for field in fields(PpoConfig):
        value, default = known.get(field.name), getattr(KeptOptions, field.name, field.default)
        if field.name in NOT_NAMED or value is None or (value == default and field.name not in NAMED_ALWAYS):
            continue
        option = field.name.replace("_", "-")
        if isinstance(value, bool):
            words.append(f"--{option}" if value else f"--no-{option}")
        else:
            words += [f"--{option}", *(map(str, value) if isinstance(value, list | tuple) else [str(value)])]
    return shlex.join(words)


def _shipped_file(env_id: str, hyperparameters: Mapping[str, Any]) -> str | None:
    """The file of shipped hyperparameters that a run was made with, if it is not the one by default."""
    for file in sorted(SHIPPED_FILE.parent.glob("*.yaml")):
        try:
            shipped = read_hyperparameters(env_id, file)
        except UsageError:
            continue
        named = {name: hyperparameters.get(name) for name in ("n_timesteps", "n_envs")}
        if file != SHIPPED_FILE and asdict(replace(shipped, **named)) == hyperparameters:
            return file.relative_to(SHIPPED_FILE.parents[2]).as_posix()
    return None
