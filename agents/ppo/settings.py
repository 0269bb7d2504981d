"""What a run is: settings from the command line, or from the folder of a run that goes on."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.policies.registry import POLICIES
from agents.ppo.hyperparameters import Hyperparameters, checked, read_hyperparameters
from agents.ppo.network.files import SETTINGS_FILE
from agents.ppo.network.policy_network import pictures
from agents.ppo.run_config import TrainConfig
from agents.ppo.workers import EnvSettings
from labeling.core.errors import EpisodeFormatError, SbmError, UsageError
from labeling.io.formats.checked_json import read_json
from labeling.runtime.run_folder import claim_run_folder

CHANGEABLE = ("n_timesteps", "n_envs")
"""Hyperparameters that a run may go on with in another size."""


@dataclass(frozen=True)
class RunSettings:
    """Everything that decides how a run goes, apart from the machine."""

    folder: Path
    env: EnvSettings
    seed: int
    imitate: str
    imitate_episodes: int
    eval_every: int
    eval_episodes: int
    hyperparameters: Hyperparameters

    def as_json(self) -> dict[str, Any]:
        """As it is written into the folder."""
        return {
            "env": self.env.env,
            "detector": self.env.detector,
            "reward": self.env.reward,
            "seed": self.seed,
            "imitate": self.imitate,
            "imitate_episodes": self.imitate_episodes,
            "eval_every": self.eval_every,
            "eval_episodes": self.eval_episodes,
            "hyperparameters": dataclasses.asdict(self.hyperparameters),
        }


def settle(config: TrainConfig) -> RunSettings:
    """The settings of the run that is asked for; notes those of a new run in its folder.

    Raises:
        SbmError: if a setting makes no sense, or the folder holds something else.
    """
    _check(config)
    if config.resume is not None:
        settings = _of_run(config, config.resume)
    else:
        env_id = config.env.rpartition(":")[2]
        folder = config.out or Path("out/ppo") / env_id.rpartition("/")[2]
        settings = RunSettings(
            folder,
            EnvSettings(config.env, config.detector, config.reward),
            config.seed,
            config.imitate,
            config.imitate_episodes,
            config.eval_every,
            config.eval_episodes,
            read_hyperparameters(env_id, config.hyperparams),
        )
    asked = {"n_timesteps": config.steps, "n_envs": config.envs}
    sizes = {name: value for name, value in asked.items() if value is not None}
    hyperparameters = dataclasses.replace(settings.hyperparameters, **sizes)
    if hyperparameters.env_wrapper and settings.imitate_episodes:
        raise UsageError(
            "--imitate-episodes: hand-written policies show moves, so hyperparameters must have no env_wrapper"
        )
    env = dataclasses.replace(
        settings.env,
        colours="rgb" in pictures(hyperparameters.policy_kwargs),
        priorities=hyperparameters.env_wrapper is not None,
    )
    settings = dataclasses.replace(settings, env=env, hyperparameters=hyperparameters)
    _check_batches(settings.hyperparameters)
    return settings


def claim(settings: RunSettings) -> None:
    """Notes the settings in the folder of the run.

    Raises:
        UsageError: if the folder holds a run with other settings, or something else, or cannot be written to.
    """
    claim_run_folder(settings.folder, SETTINGS_FILE, settings.as_json(), _identity, "a run")


def _identity(content: Mapping[str, Any]) -> dict[str, Any]:
    """What must not change when a run goes on, flat."""
    inner = content.get("hyperparameters")
    inner = inner if isinstance(inner, dict) else {}
    outer = {name: value for name, value in content.items() if name not in ("hyperparameters", "eval_every")}
    return outer | {name: value for name, value in inner.items() if name not in CHANGEABLE}


def _of_run(config: TrainConfig, folder: Path) -> RunSettings:
    """The settings that a run was started with.

    Raises:
        SbmError: if there is no run, or something is asked of it that it is not.
    """
    path = folder / SETTINGS_FILE
    if not path.is_file():
        raise UsageError(f"--resume {folder}: is not the folder of a run, it has no {SETTINGS_FILE}")
    content = read_json(path)
    try:
        settings = RunSettings(
            folder,
            EnvSettings(content.text("env"), content.text("detector"), content.text("reward")),  # type: ignore[arg-type]
            content.integer("seed"),
            content.text("imitate"),
            content.integer("imitate_episodes"),
            content.integer("eval_every"),
            content.integer("eval_episodes"),
            checked(content.get("hyperparameters").mapping(), str(path)),
        )
    except EpisodeFormatError as error:
        raise SbmError(f"--resume: {error}") from None
    defaults = TrainConfig()
    for name in (
        "env",
        "detector",
        "reward",
        "seed",
        "imitate",
        "imitate_episodes",
        "eval_every",
        "eval_episodes",
        "out",
        "hyperparams",
    ):
        given = getattr(config, name)
        kept = {**content.mapping(), "out": folder, "hyperparams": None}[name]
        if given != getattr(defaults, name) and given != kept:
            option = name.replace("_", "-")
            raise UsageError(
                f"--{option} {given} cannot be given with --resume {folder}, which goes on as it was begun"
            )
    return settings


def _check(config: TrainConfig) -> None:
    for name in ("steps", "envs", "eval_every", "eval_episodes"):
        value = getattr(config, name)
        if value is not None and value < 1:
            raise UsageError(f"--{name.replace('_', '-')} must be at least 1, not {value}")
    if config.imitate not in POLICIES:
        raise UsageError(f"--imitate {config.imitate}: no hand-written policy; there are {', '.join(sorted(POLICIES))}")
    if config.imitate_episodes < 0:
        raise UsageError(f"--imitate-episodes must not be negative, not {config.imitate_episodes}")
    if not 0 <= config.seed < 2**31:
        raise UsageError(f"--seed must lie from 0 to 2147483647, not {config.seed}")


def _check_batches(hyperparameters: Hyperparameters) -> None:
    size, batch = hyperparameters.n_envs * hyperparameters.n_steps, hyperparameters.batch_size
    if batch < 2 or size % batch:
        raise UsageError(
            f"batch_size {batch} must divide n_envs * n_steps = {hyperparameters.n_envs} * {hyperparameters.n_steps} = "
            f"{size}; give other hyperparameters, or another --envs"
        )
