"""Hyperparameters from YAML, one entry per env id, in the shape that users of rl-zoo know. Nothing is evaluated."""

import ast
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from labeling.core.errors import UsageError

FOLDER = Path(__file__).resolve().parents[1] / "hyperparams"
LINEAR = "lin_"
SCHEDULED = ("learning_rate", "clip_range")
WRAPPERS = ("agents.ppo.network.prioritised_views.PrioritisedViews",)
NORMALIZE = {"norm_obs": False, "norm_reward": True}


@dataclass(frozen=True)
class Hyperparameters:
    """Settings of PPO; names and meanings as in Stable-Baselines3."""

    n_timesteps: int
    """Steps of the environment in all."""
    n_envs: int = 4
    env_wrapper: str | None = None
    """What is put around the environment, one of ``WRAPPERS``: other actions for the same world."""
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
    """Arguments of the network, see ``agents.ppo.network.policy_network``."""

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


def read_hyperparameters(env_id: str, path: Path | None = None) -> Hyperparameters:
    """The hyperparameters for an environment.

    Args:
        env_id: Gymnasium id.
        path: a YAML file; None finds the one that comes with the project.

    Raises:
        UsageError: if there are none for it, or something in them makes no sense.
    """
    shipped = path is None
    path = path or FOLDER / f"{env_id.rpartition('/')[2]}.yaml"
    if shipped and not path.is_file():
        known = ", ".join(sorted(file.stem for file in FOLDER.glob("*.yaml")))
        raise UsageError(f"no hyperparameters for {env_id!r} (there are some for {known}); give --hyperparams FILE")
    entry = _read_yaml(path)
    if env_id not in entry:
        raise UsageError(f"{path}: has no entry {env_id!r}, only {', '.join(map(str, entry)) or 'nothing'}")
    if not isinstance(entry[env_id], dict):
        raise UsageError(f"{path}: the entry {env_id!r} must map names of hyperparameters to values")
    return checked(entry[env_id], str(path))


def _read_yaml(path: Path) -> dict[Any, Any]:
    import yaml

    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: is not YAML ({' '.join(str(error).split())})") from None
    if not isinstance(content, dict):
        raise UsageError(f"{path}: must map env ids to hyperparameters")
    return content


def checked(entry: dict[Any, Any], source: str) -> Hyperparameters:
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
    values: dict[str, Any] = {}
    for name, value in entry.items():
        if name == "use_sde":
            if not isinstance(value, bool):
                raise UsageError(f"{source}: use_sde must be true or false, not {value!r}")
            values[name] = value
        elif name == "sde_sample_freq" and value == -1:
            values[name] = -1
        elif known[name].type is int:
            values[name] = _whole(name, value, source)
        elif name in ("normalize", "policy_kwargs"):
            values[name] = _mapping(name, value, source)
        elif name == "env_wrapper":
            if value is not None and value not in WRAPPERS:
                raise UsageError(f"{source}: unknown env_wrapper {value!r}; known: {', '.join(WRAPPERS)}")
            values[name] = value
        elif name == "policy":
            values[name] = str(value)
        elif name == "target_kl" and value is None:
            values[name] = None
        else:
            values[name] = _number(name, value, source)
    values["normalize"] = NORMALIZE | values.get("normalize", {})
    wrong = [name for name in values["normalize"] if name not in (*NORMALIZE, "clip_reward")]
    if wrong or values["normalize"]["norm_obs"]:
        raise UsageError(f"{source}: normalize may hold norm_reward and clip_reward; observations are scaled already")
    return Hyperparameters(**values)


def _whole(name: str, value: Any, source: str) -> int:
    number = _number(name, value, source)
    if isinstance(number, str) or number != int(number) or number < 1:
        raise UsageError(f"{source}: {name} must be a whole number above 0, not {value!r}")
    return int(number)


def _number(name: str, value: Any, source: str) -> float | str:
    """A number; YAML reads 3e-4, without a point, as text."""
    text = str(value)
    linear = name in SCHEDULED and text.startswith(LINEAR)
    try:
        number = float(text.removeprefix(LINEAR) if linear else text)
    except ValueError:
        number = float("nan")
    if isinstance(value, bool) or not 0 <= number < float("inf"):
        raise UsageError(f"{source}: {name} must be a number from 0{', or lin_0.0003' * linear}, not {value!r}")
    return text if linear else number


def _mapping(name: str, value: Any, source: str) -> dict[str, Any]:
    """A mapping of YAML, or one written as Python in a string; ``true`` and ``false`` as rl-zoo has them."""
    if name == "normalize" and isinstance(value, bool):
        return {"norm_reward": value}
    if isinstance(value, str):
        try:
            value = _literal(ast.parse(value, mode="eval").body)
        except (SyntaxError, ValueError):
            raise UsageError(f"{source}: {name} is no mapping of plain values: {value!r}") from None
    if not isinstance(value, dict):
        raise UsageError(f"{source}: {name} must be a mapping, not {value!r}")
    return value


def _literal(node: ast.expr) -> Any:
    """What an expression of literals stands for: ``dict(a=1)`` is a mapping, ``nn.Tanh`` its name ``"Tanh"``.

    Raises:
        ValueError: if it is more than that.
    """
    if isinstance(node, ast.Dict):
        return {_literal(key): _literal(value) for key, value in zip(node.keys, node.values, strict=True) if key}
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "dict" and not node.args:
        return {str(keyword.arg): _literal(keyword.value) for keyword in node.keywords}
    if isinstance(node, ast.List | ast.Tuple):
        return [_literal(element) for element in node.elts]
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "nn":
        return node.attr
    return ast.literal_eval(node)
