"""What people hand to the environment, checked: constructor arguments, actions and options of ``reset``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from labeling.formats.pixel_limit import too_large
from sbm_gym.env.rewards import REWARDS
from sbm_gym.env.simulation import GAZES
from sbm_gym.robot.body import BodyConfig
from sbm_gym.scenes.compiled import SPLITS
from sbm_gym.worlds.geometry.navigable import AGENT_RADIUS_M, NavigableMap

MAX_STRIDE_M = 10.0
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
    if num_views is not None:
        _check_count("num_views", num_views)
    if stride_m is not None and not (_is_number(stride_m) and 0.0 < stride_m <= MAX_STRIDE_M):
        raise ValueError(f"stride_m must be positive and at most {MAX_STRIDE_M:g} m, not {stride_m!r}")
    _check_count("episodes_per_scene", episodes_per_scene)


def check_body(body: BodyConfig) -> None:
    """Checks that the agent fits where maps of worlds say that it may stand.

    Raises:
        ValueError: if it is too wide for that.
    """
    if not 0.0 < body.radius_m <= AGENT_RADIUS_M:
        raise ValueError(
            f"body: radius_m must be above 0 and at most {AGENT_RADIUS_M:g} m, for which worlds say where one can "
            f"stand, not {body.radius_m!r}"
        )


def check_sizes(**sizes: Any) -> None:
    """Checks heights and widths of pictures, pixels; None stands for a default.

    Raises:
        ValueError: if one is not two whole numbers above 0, or a picture would have more pixels than are accepted.
    """
    for name, size in sizes.items():
        if size is None:
            continue
        if not (isinstance(size, Sequence) and len(size) == 2 and all(_is_count(side) for side in size)):
            raise ValueError(f"{name} must be height and width, two whole numbers above 0, not {size!r}")
        why = too_large(*size)
        if why is not None:
            raise ValueError(f"{name}: {why}")


def _check_count(name: str, value: Any) -> None:
    if not _is_count(value):
        raise ValueError(f"{name} must be a whole number of at least 1, not {value!r}")


def _is_count(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and bool(value >= 1)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


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
