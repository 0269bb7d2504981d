"""Hyperparameters from YAML, one mapping per env id, in the shape that users of rl-zoo3 know."""

import functools
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any

from agents.planning.moves_and_looks import MovesAndLooks
from agents.planning.promises import WITHOUT
from labeling.core.errors import UsageError
from labeling.formats.regular_file import regular

SHIPPED_FILE = Path(__file__).resolve().parents[1] / "hyperparams" / "ppo.yaml"
DEFAULT = "default"
"""The entry for environments that have none of their own."""
LINEAR = "lin_"
SCHEDULED = ("learning_rate", "clip_range")
ENV_WRAPPERS = {name: functools.partial(MovesAndLooks, name=name) for name in WITHOUT}
NORMALIZE = {"norm_obs": False, "norm_reward": True}
MAX_EPOCHS = 1000
"""Times that a rollout may be learnt from; more would not end."""


@dataclass(frozen=True)
class Hyperparameters:
    """Settings of PPO; names and meanings as in Stable-Baselines3."""

    n_timesteps: int
    """Steps of the environment in all."""
    n_envs: int = 4
    env_wrapper: str | None = None
    """What is put around the environment, one of ``ENV_WRAPPERS``, which changes what actions mean."""
    policy: str = "MultiInputPolicy"
    n_steps: int = 500
    """Steps of each environment between updates."""
    batch_size: int = 250
    n_epochs: int = 10
    gamma: float = 0.99
    gae_lambda: float = 0.95
    clip_range: float | str = 0.2
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    target_kl: float | None = None
    use_sde: bool = False
    """Exploration that depends on the state and stays the same for some steps (gSDE), not noise of every step."""
    sde_sample_freq: int = -1
    """For so many steps; with the number of views, for an episode. -1: until the next update."""
    learning_rate: float | str = 3e-4
    """A number, or ``lin_`` and a number: falls to 0 over the run; as may ``clip_range``."""
    normalize: dict[str, Any] = field(default_factory=lambda: dict(NORMALIZE))
    """Arguments of ``VecNormalize``. Observations are scaled already, so ``norm_obs`` must stay off."""
    policy_kwargs: dict[str, Any] = field(default_factory=dict)
    """Arguments of the network, see ``agents.network.policy_network``."""

    def ppo_arguments(self) -> dict[str, Any]:
        """What Stable-Baselines3's ``PPO`` takes, but for policy, environment and network."""
        elsewhere = ("n_timesteps", "n_envs", "env_wrapper", "policy", "normalize", "policy_kwargs")
        arguments = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in elsewhere}
        return arguments | {name: schedule(arguments[name]) for name in SCHEDULED}


def schedule(value: float | str) -> Any:
    """A number as it is; ``lin_`` and a number as a function of the share of the run that is left."""
    if not isinstance(value, str):
        return value
    start = float(value.removeprefix(LINEAR))
    return lambda left: left * start


def read_hyperparameters(
    env_id: str, path: Path | None = None, say: Callable[[str], None] = lambda _: None
) -> Hyperparameters:
    """The hyperparameters for an environment.

    Args:
        env_id: Gymnasium id.
        path: a YAML file; None takes the one that comes with the project.
        say: where it is told that the environment has none of its own, and got those of ``DEFAULT``.

    Raises:
        UsageError: if there are none for it, or something in them makes no sense.
    """
    file = path or SHIPPED_FILE
    entries = _read_yaml(file)
    fallback = entries.get(DEFAULT)
    # Files may have an entry of that name only for others to be made from.
    is_whole = isinstance(fallback, dict) and "n_timesteps" in fallback
    name = DEFAULT if env_id not in entries and is_whole else env_id
    if name not in entries:
        raise UsageError(f"{file}: has no entry {env_id!r}, only {', '.join(map(str, entries)) or 'nothing'}")
    if not isinstance(entries[name], dict):
        raise UsageError(f"{file}: the entry {name!r} must map names of hyperparameters to values")
    found = checked_hyperparameters(entries[name], str(file))
    if name != env_id:
        say(f"hyperparameters: {file} has none for {env_id!r}, so those of its entry {name!r} are taken")
    return found


def _read_yaml(path: Path) -> dict[Any, Any]:
    import yaml

    try:
        content = yaml.safe_load(regular(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: is not YAML ({' '.join(str(error).split())})") from None
    if not isinstance(content, dict):
        raise UsageError(f"{path}: must map env ids to hyperparameters")
    return content


def checked_hyperparameters(entry: Mapping[Any, Any], source: str) -> Hyperparameters:
    """Hyperparameters from plain values.

    Args:
        entry: values by name, as YAML or JSON holds them.
        source: where they are from, for messages.

    Raises:
        UsageError: if a name is unknown or a value makes no sense.
    """
    known = {f.name: f for f in fields(Hyperparameters)}
    unknown = [name for name in entry if name not in known]
    if unknown:
        raise UsageError(f"{source}: unknown hyperparameter {unknown[0]!r}; known: {', '.join(known)}")
    if "n_timesteps" not in entry:
        raise UsageError(f"{source}: n_timesteps is missing")
    if isinstance(entry.get("normalize"), bool):  # as rl-zoo3 may have it
        entry = {**entry, "normalize": {"norm_reward": entry["normalize"]}}
    values = {}
    for name, value in entry.items():
        wanted, convert = KINDS[known[name].type]
        try:
            values[name] = value if _is_default(known[name], value) else convert(value)
        except (ValueError, TypeError):
            raise UsageError(f"{source}: {name} must be {wanted}, not {value!r}") from None
    if values.get("n_epochs", 1) > MAX_EPOCHS:
        raise UsageError(f"{source}: n_epochs must be at most {MAX_EPOCHS}, not {values['n_epochs']}: it would not end")
    normalize = values["normalize"] = NORMALIZE | values.get("normalize", {})
    if normalize["norm_obs"] or not normalize.keys() <= {*NORMALIZE, "clip_reward"}:
        raise UsageError(f"{source}: normalize may hold norm_reward and clip_reward; observations are scaled already")
    clip = normalize.get("clip_reward", 1.0)
    if not isinstance(normalize["norm_reward"], bool) or isinstance(clip, bool) or not isinstance(clip, int | float):
        raise UsageError(f"{source}: norm_reward must be true or false, and clip_reward a number, not {normalize}")
    if not 0.0 < clip < float("inf"):
        raise UsageError(f"{source}: clip_reward must be above 0, not {clip}")
    for name in ("gamma", "gae_lambda"):
        if values.get(name, 1.0) > 1.0:
            raise UsageError(f"{source}: {name} must be at most 1, not {values[name]}")
    return Hyperparameters(**values)


def _is_default(setting: Field, value: Any) -> bool:
    """Whether a value is that of a setting by default, such as None or -1, which others of its kind may not be."""
    return type(value) is type(setting.default) and value == setting.default


# For each kind of setting: the value as the setting has it, ValueError or TypeError if it is of another kind.


def _number(value: Any) -> float:
    number = float(value)  # YAML reads 3e-4, without a point, as text
    if isinstance(value, bool) or not 0.0 <= number < float("inf"):
        raise ValueError
    return number


def _count(value: Any) -> int:
    number = _number(value)
    if number < 1.0 or not number.is_integer():
        raise ValueError
    return int(number)


def _number_or_schedule(value: Any) -> float | str:
    if not isinstance(value, str) or not value.startswith(LINEAR):
        return _number(value)
    _number(value.removeprefix(LINEAR))
    return value


def _env_wrapper(value: Any) -> str:
    if value not in ENV_WRAPPERS:
        raise ValueError
    return value


def _instance(kind: type, value: Any) -> Any:
    if not isinstance(value, kind):
        raise TypeError
    return value


KINDS: dict[Any, tuple[str, Callable[[Any], Any]]] = {
    int: ("a whole number above 0", _count),
    float: ("a number from 0", _number),
    float | None: ("a number from 0", _number),
    float | str: ("a number from 0, or lin_0.0003", _number_or_schedule),
    bool: ("true or false", functools.partial(_instance, bool)),
    str: ("a name", functools.partial(_instance, str)),
    str | None: (f"one of {', '.join(ENV_WRAPPERS)}", _env_wrapper),
    dict[str, Any]: ("a mapping", functools.partial(_instance, dict)),
}
"""By the type of a setting: what its values are, in words, and the function that converts them."""
