"""What people hand to the environment, checked: constructor arguments, actions and options of ``reset``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from sbm_gym.env.rewards import REWARDS
from sbm_gym.env.simulation import GAZES
from sbm_gym.scenes.compiled import SPLITS
from sbm_gym.worlds.geometry.navigable import NavigableMap

RESET_OPTIONS = ("scene", "start", "reuse_scene")


def check_choices(
    split: str | None, gaze: str, reward: str, render_mode: str | None, render_modes: Sequence[str]
) -> None:
    """Checks the constructor's names.

    Raises:
        ValueError: if one is unknown, naming the alternatives.
    """
    if split is not None and split not in SPLITS:
        raise ValueError(f"unknown split {split!r}; known: {', '.join(SPLITS)}, or None for all scenes")
    if gaze not in GAZES:
        raise ValueError(f"unknown gaze {gaze!r}; known: {', '.join(GAZES)}")
    if reward not in REWARDS:
        raise ValueError(f"unknown reward {reward!r}; known: {', '.join(REWARDS)}")
    if render_mode is not None and render_mode not in render_modes:
        raise ValueError(f"unknown render_mode {render_mode!r}; known: {', '.join(render_modes)}")


def check_numbers(num_views: int | None, stride_m: float | None, episodes_per_scene: int) -> None:
    """Checks the constructor's numbers; None stands for a default.

    Raises:
        ValueError: if one makes no sense, saying what would.
    """
    if num_views is not None and num_views < 1:
        raise ValueError(f"num_views must be at least 1, not {num_views}")
    if stride_m is not None and not stride_m > 0.0:
        raise ValueError(f"stride_m must be positive, not {stride_m}")
    if episodes_per_scene < 1:
        raise ValueError(f"episodes_per_scene must be at least 1, not {episodes_per_scene}")


def checked_options(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Options of ``reset``.

    Raises:
        ValueError: if there is an unknown one, naming those there are.
    """
    options = dict(options or {})
    unknown = sorted(set(options) - set(RESET_OPTIONS))
    if unknown:
        raise ValueError(f"unknown reset option {unknown[0]!r}; known: {', '.join(RESET_OPTIONS)}")
    return options


def checked_start(start: Any, navigable: NavigableMap) -> Float[np.ndarray, "2"] | Float[np.ndarray, "3"]:
    """The option ``start`` as (x, y) or (x, y, yaw).

    Raises:
        ValueError: if it is something else, or the robot cannot stand there, naming the nearest place where it can.
    """
    place = np.asarray(start, float)
    if place.shape not in ((2,), (3,)) or not np.all(np.isfinite(place)):
        raise ValueError(f"option 'start' is (x, y) or (x, y, yaw) in metres and radians, not {start}")
    if not navigable.is_free(place[:2]):
        free = navigable.nearest_free(place[:2])
        raise ValueError(
            f"option 'start': the robot cannot stand at ({place[0]:g}, {place[1]:g}); "
            f"the nearest free place is ({free[0]:.2f}, {free[1]:.2f})"
        )
    return place


def checked_action(action: Any) -> Float[np.ndarray, "4"]:
    """An action, clipped to what is allowed.

    Raises:
        ValueError: if it is not four finite numbers.
    """
    action = np.asarray(action, float)
    if action.shape != (4,) or not np.all(np.isfinite(action)):
        raise ValueError(f"an action is four finite numbers (forward, left, gaze yaw, gaze pitch), not {action}")
    return np.clip(action, -1.0, 1.0)
