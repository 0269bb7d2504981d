"""Films of episodes while they are played: Gymnasium's ``RecordVideo``, as GIFs, which need no moviepy."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import logger
from gymnasium.utils import RecordConstructorArgs

from labeling.core.errors import SbmError, UsageError

PICTURES = ("rgb_array", "third_person")
"""Render modes that can be filmed."""


class RecordFilm(gym.Wrapper, RecordConstructorArgs):
    """Films episodes as animated GIFs, one a file, named ``PREFIX-episode-N.gif``.

    Needs the extra ``video``. A film that would be too large is left out with a warning; training goes on.

    Example:
        >>> import gymnasium, sbm_gym
        >>> env = gymnasium.make("sbm_gym/IndoorBuiltin-v0", render_mode="third_person", render_size=(240, 320))
        >>> env = sbm_gym.RecordFilm(env, "FILMS", episode_trigger=lambda episode: episode % 10 == 0)
    """

    def __init__(
        self,
        env: gym.Env,
        video_folder: str | Path,
        episode_trigger: Callable[[int], bool] | None = None,
        name_prefix: str = "rl-video",
        frame_ms: int = 200,
    ) -> None:
        """Wraps an environment.

        Args:
            env: made with the render mode "rgb_array" (what the robot sees) or "third_person" (from above).
            video_folder: for the films; made with the first one.
            episode_trigger: which episodes are filmed, by their number from 0; by default the cubic numbers up to 1000
                and every 1000th, as of ``RecordVideo``.
            name_prefix: of the files' names.
            frame_ms: how long each picture is shown, milliseconds, in steps of ten.

        Raises:
            UsageError: if the environment draws no pictures.
        """
        RecordConstructorArgs.__init__(
            self,
            video_folder=video_folder,
            episode_trigger=episode_trigger,
            name_prefix=name_prefix,
            frame_ms=frame_ms,
        )
        gym.Wrapper.__init__(self, env)
        if env.render_mode not in PICTURES:
            modes = " or ".join(map(repr, PICTURES))
            raise UsageError(f"films need an environment made with render_mode {modes}, not {env.render_mode!r}")
        self._folder, self._prefix, self._frame_ms = Path(video_folder), name_prefix, frame_ms
        self._trigger = episode_trigger or _cubic_numbers
        self._episode = -1
        self._frames: list[np.ndarray] = []

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begins an episode; one that was left is filmed as far as it went."""
        self._write()
        observation, info = self.env.reset(seed=seed, options=options)
        self._episode += 1
        self._film()
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """A step, and a picture of what it led to."""
        result = self.env.step(action)
        self._film()
        if result[2] or result[3]:
            self._write()
        return result

    def close(self) -> None:
        """Writes what has been filmed and closes the environment."""
        self._write()
        self.env.close()

    def _film(self) -> None:
        if self._trigger(self._episode):
            self._frames.append(np.asarray(self.env.render()))

    def _write(self) -> None:
        frames, self._frames = self._frames, []
        if len(frames) < 2:
            return
        from labeling.formats.film import write_film

        try:
            write_film(frames, self._folder / f"{self._prefix}-episode-{self._episode}.gif", self._frame_ms)
        except SbmError as error:
            logger.warn(f"no film of episode {self._episode}: {error}")


def _cubic_numbers(episode: int) -> bool:
    """0, 1, 8, 27, ..., 1000, 2000, 3000, ..., as of Gymnasium, whose function cannot be imported without moviepy."""
    return round(episode ** (1 / 3)) ** 3 == episode if episode < 1000 else episode % 1000 == 0
