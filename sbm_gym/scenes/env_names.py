"""Environments by the names that command lines give them."""

import importlib

from labeling.core.errors import UsageError


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
        except (ImportError, ValueError, TypeError) as error:  # the last two for names such as ".x"
            raise UsageError(f"unknown env {env_id!r}: cannot import {module!r} ({error})") from error
    if name not in gym.registry:
        raise UsageError(f"unknown env {env_id!r}; known: {', '.join(known_ids())}")
    return name


def known_ids() -> list[str]:
    """Ids of the environments of this project, and of worlds of one's own that were registered."""
    import gymnasium as gym

    return sorted(name for name in gym.registry if name.startswith("sbm_gym/"))
