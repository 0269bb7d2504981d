"""The ``spin`` policy: turns on the spot by 60 degrees a step, all the way round."""

from typing import Any

import gymnasium as gym
import numpy as np

from agents.planning.steering import look
from sbm_gym.env.gaze import TURN_RAD


class Spin:
    """Never moves from its place."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""
        self._env: Any = env.unwrapped

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A sixth of a turn on."""
        wanted_rad = info["agent"]["yaw_rad"] + TURN_RAD
        tilt_rad = self._env.profile.rest_tilt_rad
        return look(info, self._env.stride_m, np.zeros(2), wanted_rad, tilt_rad).astype(np.float32)
