"""Making the environments that command lines name, with errors in one line."""

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium as gym

import sbm_gym  # noqa: F401, registers the environments
from labeling.cluster.cluster_config import SameThere
from labeling.core.errors import UsageError
from sbm_gym.assets.catalog.same_libraries import same_libraries
from sbm_gym.registration import ENV_IDS

if TYPE_CHECKING:
    from sbm_gym.env.fixation_env import FixationEnv


def make_env(env_id: str, split: str, detector: str, **settings: Any) -> gym.Env:
    """The environment; ``module:id`` imports the module first, as in ``gymnasium.make``.

    Args:
        env_id: its Gymnasium id.
        split: of scenes.
        detector: in the loop.
        settings: other arguments of the environment.

    Raises:
        UsageError: if env or detector are unknown.
    """
    module, _, name = env_id.rpartition(":")
    if module:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise UsageError(f"unknown env {env_id!r}: cannot import {module!r} ({error})") from error
    if name not in gym.registry:
        raise UsageError(f"unknown env {env_id!r}; known: {', '.join(sorted(ENV_IDS))}")
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


def inner_env(env: gym.Env) -> "FixationEnv":
    """The environment inside its wrappers."""
    from sbm_gym.env.fixation_env import FixationEnv

    inner = env.unwrapped
    assert isinstance(inner, FixationEnv)
    return inner


def same_furniture(env: gym.Env) -> tuple[SameThere, ...]:
    """What nodes of a cluster must have to make the same worlds."""
    return same_libraries(env.spec.kwargs.get("worlds") if env.spec else None)


def capture_size(env: gym.Env, height_px: int | None) -> tuple[int, int]:
    """Height and width of recorded pictures: the world's, or of its shape and the height asked for."""
    height, width = inner_env(env).profile.capture_size
    return (height, width) if height_px is None else (height_px, round(height_px * width / height))
