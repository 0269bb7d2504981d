"""Making the environments that command lines name, with errors in one line."""

from typing import TYPE_CHECKING, Any

from labeling.core.errors import UsageError
from sbm_gym.scenes.env_names import known_ids, registered_id

if TYPE_CHECKING:
    import gymnasium as gym


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
            f"env {env_id!r} has no scenes and no detector, as those of this project: {', '.join(known_ids())}"
        ) from None
    except (ImportError, gym.error.Error) as error:
        raise UsageError(f"env {env_id!r}: cannot be made ({error})") from None
