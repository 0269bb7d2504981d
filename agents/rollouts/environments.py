"""What the environment inside its wrappers is, and needs."""

from typing import TYPE_CHECKING

import gymnasium as gym

from labeling.cluster.cluster_config import SameThere
from sbm_gym.assets.catalog.same_libraries import same_libraries

if TYPE_CHECKING:
    from sbm_gym.env.fixation_env import FixationEnv


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
