"""The settings of a run: from the command line, or from the folder of a run that goes on."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents.network.files import SETTINGS_FILE
from agents.network.policy_network import observed_keys
from agents.ppo.config import KEPT, KeptOptions, PpoConfig
from agents.ppo.envs import EnvConfig
from agents.ppo.hyperparameters import Hyperparameters, checked_hyperparameters, read_hyperparameters
from agents.rollouts.scene_shares import LEARNT_FROM
from labeling.core.errors import EpisodeFormatError, SbmError, UsageError
from labeling.formats.checked_json import read_json
from labeling.runtime.ranges import check_ranges
from labeling.runtime.run_folder import claim_run_folder

DIGESTS = "weights"
"""Where the folder's settings say what stood behind names, such as that of the detector, when the run was begun."""
CHANGEABLE = ("eval_every", "n_timesteps", "n_envs")
"""Of what the folder of a run keeps, options and hyperparameters, what it may go on with in another size."""


@dataclass(frozen=True)
class RunSettings:
    """Everything that decides how a run goes, apart from the machine."""

    folder: Path
    options: KeptOptions
    hyperparameters: Hyperparameters

    @property
    def env_config(self) -> EnvConfig:
        """The environment to train in."""
        options, hyperparameters = self.options, self.hyperparameters
        return EnvConfig(
            env=options.env,
            detector=options.detector,
            reward=options.reward,
            keys=observed_keys(hyperparameters.policy, hyperparameters.policy_kwargs),
            wrapper=hyperparameters.env_wrapper,
            atlas=None if options.atlas is None else str(options.atlas),
            scenes=options.scenes,
            validation_scenes=options.validation_scenes,
        )

    @property
    def validation_config(self) -> EnvConfig:
        """The environment to validate in: always with a full reward."""
        config = self.env_config
        return config if config.reward == "evidence" else dataclasses.replace(config, reward="both")

    def as_json(self) -> dict[str, Any]:
        """As it is written into the folder."""
        kept = {name: getattr(self.options, name) for name in KEPT}
        kept["atlas"] = self.env_config.atlas
        return kept | {"hyperparameters": dataclasses.asdict(self.hyperparameters)}


def resolve_settings(config: PpoConfig, say: Callable[[str], None] = lambda _: None) -> RunSettings:
    """The settings of the run that is asked for.

    Args:
        config: what is asked for.
        say: where it is told what has been taken that was not asked for.

    Raises:
        SbmError: if a setting makes no sense, or there is no run to go on with.
    """
    check_ranges(config)
    given = {name: getattr(config, name) for name in KEPT if getattr(config, name) is not None}
    if config.resume is None:
        options = KeptOptions(**given)
        _check_scenes(options)
        env_id = options.env.rpartition(":")[2]
        folder = config.out or Path("out/ppo") / env_id.rpartition("/")[2]
        settings = RunSettings(folder, options, read_hyperparameters(env_id, config.hyperparams, say))
    else:
        settings = _resumed(config, given, config.resume)
        _check_scenes(settings.options)
    asked = {"n_timesteps": config.steps, "n_envs": config.envs}
    asked = {name: value for name, value in asked.items() if value is not None}
    hyperparameters = dataclasses.replace(settings.hyperparameters, **asked)
    _check_batches(hyperparameters)
    return dataclasses.replace(settings, hyperparameters=hyperparameters)


def _check_scenes(options: KeptOptions) -> None:
    if options.scenes + options.validation_scenes > LEARNT_FROM:
        raise UsageError(
            f"--scenes and --validation-scenes must be {LEARNT_FROM} or less together, not {options.scenes} and "
            f"{options.validation_scenes}: the others are for comparing policies"
        )


def _check_batches(hyperparameters: Hyperparameters) -> None:
    envs, steps, batch = hyperparameters.n_envs, hyperparameters.n_steps, hyperparameters.batch_size
    if batch >= 2 and envs * steps % batch == 0:
        return
    advice = "give other hyperparameters"
    if batch >= 2:
        fitting = batch // math.gcd(batch, steps)
        near = [number for number in (envs // fitting * fitting, (envs // fitting + 1) * fitting) if number]
        advice = f"give --envs {' or '.join(map(str, near))}, or other hyperparameters"
    raise UsageError(f"batch_size {batch} must divide n_envs * n_steps = {envs} * {steps} = {envs * steps}; {advice}")


def _resumed(config: PpoConfig, given: dict[str, Any], folder: Path) -> RunSettings:
    """The settings that a run was begun with, and goes on with.

    Args:
        config: what is asked for.
        given: of the options that a folder keeps, those that were given.
        folder: of the run.

    Raises:
        SbmError: if there is no run, or options are given that it was not begun with.
    """
    if not (folder / SETTINGS_FILE).is_file():
        raise UsageError(f"--resume {folder}: is not the folder of a run, it has no {SETTINGS_FILE}")
    try:
        settings = _read_settings(folder)
    except EpisodeFormatError as error:
        raise SbmError(f"--resume: {error}") from None
    begun_with = {name: getattr(settings.options, name) for name in KEPT} | {"out": folder, "hyperparams": None}
    elsewhere = {"out": config.out, "hyperparams": config.hyperparams}
    for name, value in (given | {name: value for name, value in elsewhere.items() if value is not None}).items():
        if name not in CHANGEABLE and value != begun_with[name]:
            option = name.replace("_", "-")
            raise UsageError(
                f"--{option} {value} cannot be given with --resume {folder}, which goes on as it was begun"
            )
    for name in ("env", "detector"):
        kept = begun_with[name]
        if _names_code(kept) and name not in given and not config.allow_code:
            raise UsageError(
                f"{folder / SETTINGS_FILE}: {name} {kept!r} is Python code, which would be run; if you trust it, give "
                "--allow-code"
            )
    changed = {name: value for name, value in given.items() if name in CHANGEABLE}
    return dataclasses.replace(settings, options=dataclasses.replace(settings.options, **changed))


def _names_code(name: str) -> bool:
    """Whether the name of an env or a detector is that of Python code: ``module:...``."""
    kind, colon, _ = name.partition(":")
    return bool(colon) and kind not in ("onnx", "simulated")


def _read_settings(folder: Path) -> RunSettings:
    """The settings in the folder of a run; settings that are no more may be among them."""
    path = folder / SETTINGS_FILE
    content = read_json(path)
    options: dict[str, Any] = {
        name: content.integer(name) if isinstance(getattr(KeptOptions, name), int) else content.text(name)
        for name in KEPT
        if name != "atlas"
    }
    if content.get("atlas").value is not None:
        options["atlas"] = Path(content.text("atlas"))
    hyperparameters = checked_hyperparameters(content.get("hyperparameters").mapping(), str(path))
    return RunSettings(folder, KeptOptions(**options), hyperparameters)


def claim_run(settings: RunSettings, digests: Mapping[str, str]) -> None:
    """Notes the settings in the folder of the run.

    Args:
        settings: of the run.
        digests: by name, of what stands behind names in the settings, which may come to stand for something else.

    Raises:
        SbmError: if the folder holds a run with other settings, or something else, or cannot be written to.
    """
    source = str(settings.folder / SETTINGS_FILE)

    def fixed(content: Mapping[str, Any]) -> dict[str, Any]:
        """What must not change when a run goes on, flat; runs begun before digests were kept have any."""
        hyperparameters = checked_hyperparameters(content.get("hyperparameters", {}), source)
        flat = {name: content.get(name) for name in KEPT} | dataclasses.asdict(hyperparameters)
        unchanging = {name: value for name, value in flat.items() if name not in CHANGEABLE}
        return unchanging | {**digests, **content.get(DIGESTS, {})}

    content = settings.as_json() | ({DIGESTS: dict(digests)} if digests else {})
    claim_run_folder(settings.folder, SETTINGS_FILE, content, fixed, "a run")
