"""The ``spin`` policy: turns on the spot by 60 degrees a step, all the way round.

Once an object is confirmed, the env lets the camera point no farther than 45 degrees past a confirmed object. Where
that keeps it from turning on, it turns back the other way.
"""

from typing import Any

import gymnasium as gym
import numpy as np

from agents.steering import look, nearest_allowed, wrap
from sbm_gym.episode import TURN_RAD

LEAST_TURN_RAD = np.deg2rad(5.0)


class Spin:
    """Never moves from its place."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""
        self._env: Any = env.unwrapped
        self._direction = 1.0

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A sixth of a turn on, or as much of it as the env allows."""
        agent = info["agent"]
        if info["confirmed_objects"] and self._turn_rad(info) * self._direction < LEAST_TURN_RAD:
            self._direction = -self._direction
        wanted_rad = agent["yaw_rad"] + self._direction * TURN_RAD
        action = look(self._env, info, np.zeros(2), wanted_rad, self._env.profile.rest_tilt_rad)
        return action.astype(np.float32)

    def _turn_rad(self, info: dict[str, Any]) -> float:
        """How far the camera would turn if it went on in its direction."""
        agent, objects = info["agent"], info["confirmed_objects"]
        wanted_rad = agent["yaw_rad"] + self._direction * TURN_RAD
        object_id, offset_rad = nearest_allowed(wanted_rad, agent["position_m"], objects)
        offset = objects[object_id]["centroid_m"][:2] - agent["position_m"]
        return float(wrap(np.arctan2(offset[1], offset[0]) + offset_rad - agent["yaw_rad"]))
