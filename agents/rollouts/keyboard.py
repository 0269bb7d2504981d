"""Moving a robot by the keyboard: which keys do what, and the window in which it is seen."""

import itertools
import os
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float32

from labeling.core.errors import SbmError
from labeling.runtime.extras import how_to_install
from sbm_gym.env.viewer_window import screen_available

FULL, TURN, TILT = 1.0, 0.5, 0.5
"""Actions of a key: a stride, half of a turn of the gaze, half of a tilt."""
_AXES = (
    {"w": FULL, "s": -FULL},
    {"a": FULL, "d": -FULL},
    {"q": TURN, "e": -TURN},
    {"r": TILT, "f": -TILT},
)
KEYS = "w/s forward/back, a/d left/right, q/e look left/right, r/f look up/down, several at once; escape ends it"
NO_MOVE: Float32[np.ndarray, "4"] = np.zeros(4, np.float32)

Reported = Callable[[int, float, dict[str, Any]], None]
"""Called after every step with its number in the episode from 1, its reward and ``info``."""


class NoWindowError(SbmError):
    """There is no window to play in."""


def keys_to_action() -> dict[tuple[str, ...], Float32[np.ndarray, "4"]]:
    """By every set of keys that do not contradict each other the action of a step."""
    found = {}
    for chosen in itertools.product(*((None, *axis) for axis in _AXES)):
        keys = tuple(key for key in chosen if key is not None)
        values = (axis[key] if key is not None else 0.0 for axis, key in zip(_AXES, chosen, strict=True))
        if keys:
            found[keys] = np.array(list(values), np.float32)
    return found


class PictureWindow(gym.Wrapper):
    """Says of any environment whose ``render`` returns pictures that it does so as ``rgb_array``, and begins another
    episode after each, where Gymnasium's player gives the same seed every time.
    """

    def __init__(self, env: gym.Env) -> None:
        """Wraps it."""
        super().__init__(env)
        self._has_moved = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begins the episode of the seed, and others once that has been played."""
        return self.env.reset(seed=None if self._has_moved else seed, options=options)

    def step(self, action: Any) -> Any:
        """Moves the robot."""
        self._has_moved = True
        return self.env.step(action)

    @property
    def render_mode(self) -> str:
        """What Gymnasium's player takes."""
        return "rgb_array"


def play(env: gym.Env, seed: int, zoom: float, report: Reported) -> None:
    """Plays until the window is closed; the robot waits for keys, episodes follow each other.

    Args:
        env: made with the render mode "rgb_array" or "third_person".
        seed: of the first episode.
        zoom: a factor of the size of its pictures.
        report: told of every step.

    Raises:
        NoWindowError: if pygame is not installed, or no window can be opened.
    """
    if not (screen_available() or _dummy_screen()):
        raise NoWindowError("playing needs a window, and there is no screen here (DISPLAY is not set)")
    try:
        with _quiet():
            from gymnasium.utils import play as player
    except gym.error.DependencyNotInstalled:
        raise NoWindowError(f"playing needs pygame: {how_to_install('play')}") from None
    step = itertools.count(1)

    def told(before: Any, after: Any, action: Any, reward: Any, terminated: bool, truncated: bool, info: Any) -> None:
        nonlocal step
        report(next(step), float(reward), info)
        if terminated or truncated:
            step = itertools.count(1)

    # Gymnasium's player asks for a picture before its first reset, which begins the same episode again.
    env.reset(seed=seed)
    keys, window = keys_to_action(), PictureWindow(env)
    player.play(window, zoom=zoom, callback=told, keys_to_action=keys, noop=NO_MOVE, seed=seed, wait_on_player=True)


def _dummy_screen() -> bool:
    """Whether SDL, which pygame draws with, was told to do without a screen."""
    return os.environ.get("SDL_VIDEODRIVER") in ("dummy", "offscreen")


def _quiet() -> Any:
    """Without Gymnasium's warning that curves, which are not drawn here, need Tk."""
    return warnings.catch_warnings(action="ignore", category=UserWarning)
