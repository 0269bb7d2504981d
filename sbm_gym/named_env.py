"""Making the environments that command lines name, with errors in one line."""

import importlib
from typing import TYPE_CHECKING, Any

from labeling.core.errors import UsageError
from sbm_gym.registration import ENV_IDS

if TYPE_CHECKING:
    import gymnasium as gym


def registered_id(env_id: str) -> str:
    """The id that Gymnasium knows; ``module:id`` imports the module first, as in ``gymnasium.make``.

    Raises:
        UsageError: if there is no such module or environment.
    """
    import gymnasium as gym

    module, _, name = env_id.rpartition(":")
    if module:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise UsageError(f"unknown env {env_id!r}: cannot import {module!r} ({error})") from error
    if name not in gym.registry:
        raise UsageError(f"unknown env {env_id!r}; known: {', '.join(sorted(ENV_IDS))}")
    return name


def make_env(env_id: str, split: str, detector: str, **settings: Any) -> "gym.Env":
    """The environment.

    Args:
        env_id: its Gymnasium id, as ``registered_id`` takes it.
        split: of scenes.
        detector: in the loop.
        settings: other arguments of the environment.

    Raises:
        UsageError: if env or detector are unknown, or a setting makes no sense.
    """
    import gymnasium as gym

    name = registered_id(env_id)
    try:
        return gym.make(name, split=split, detector=detector, **settings)
    except ValueError as error:
        raise UsageError(f"env {env_id!r}: {error}") from error
    except TypeError as error:
        if not any(f"unexpected keyword argument {argument!r}" in str(error) for argument in ("split", "detector")):
            raise
        raise UsageError(
            f"env {env_id!r} has no scenes and no detector, as those of this project: {', '.join(sorted(ENV_IDS))}"
        ) from None
