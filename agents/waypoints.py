"""Actions that name a place to go to: the robot drives a stride on the shortest way there, as the ``ring`` policy does.

A policy that learns need not learn to steer around furniture then, for which the map is enough, only where to go.

| | action | meaning |
|---|---|---|
| 0 | with a fixation target | distance from it: -1 is the inner, 1 the outer edge of the ring, and a bit beyond |
| 1 | with a fixation target | how far around it: a is 30 a + 120 a^3 degrees, positive is to the robot's left |
| 0, 1 | without | ahead and left of the robot, 1 is six strides |
| 2 | | gaze yaw: a stands for the environment's own a |a|, so that trying things out rarely loses the target |
| 3 | | gaze pitch: a stands for the environment's own 0.4 a |

Places that the robot cannot stand at stand for the nearest one that it can. Every step may name another place.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from agents.paths import advance
from agents.steering import bearing_rad, move_action

FINE_RAD, COARSE_RAD = np.deg2rad(30.0), np.deg2rad(120.0)
FAR_STRIDES = 6.0
PITCH_SHARE = 0.4
RING_MARGIN = 0.25
"""How far beyond the world's ring distances can be chosen, as a share of them."""


class Waypoints(gym.Wrapper):
    """An environment whose moves are named by where they lead."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        observation, self._info = self.env.reset(seed=seed, options=options)
        return observation, self._info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step; see the module."""
        observation, reward, terminated, truncated, self._info = self.env.step(
            towards(self.env.unwrapped, self._info, action)
        )
        return observation, reward, terminated, truncated, self._info


def towards(env: Any, info: dict[str, Any], action: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4"]:
    """The environment's own action for one that names a place.

    Args:
        env: the unwrapped environment.
        info: of the latest step.
        action: see the module; values beyond are clipped.
    """
    action = np.clip(np.asarray(action, float), -1.0, 1.0)
    agent = info["agent"]
    step_m = None
    if env.navigable.largest_component.any():
        goal_m = env.navigable.nearest_free(place_m(env, info, action))
        step_m = advance(env.navigable, agent["position_m"], goal_m, env.stride_m)
    move = np.zeros(2) if step_m is None else move_action(step_m, agent["yaw_rad"], env.stride_m)
    return np.array([*move, action[2] * abs(action[2]), PITCH_SHARE * action[3]])


def place_m(env: Any, info: dict[str, Any], action: Float[np.ndarray, "4"]) -> Float[np.ndarray, "2"]:
    """The place that an action names, world axes."""
    agent, target = info["agent"], info["fixation_target"]
    position_m = agent["position_m"]
    if not target:
        cos, sin = np.cos(agent["yaw_rad"]), np.sin(agent["yaw_rad"])
        ahead, left = action[:2] * FAR_STRIDES * env.stride_m
        return position_m + np.array([cos * ahead - sin * left, sin * ahead + cos * left])
    centre_m = target["centroid_m"][:2]
    low_m, high_m = env.profile.ring_m
    low_m, high_m = (1.0 - RING_MARGIN) * low_m, (1.0 + RING_MARGIN) * high_m
    distance_m = low_m + 0.5 * (action[0] + 1.0) * (high_m - low_m)
    # Who faces the middle and steps to its left goes round clockwise, seen from above.
    angle = bearing_rad(centre_m, position_m) - around_rad(action[1])
    return centre_m + distance_m * np.array([np.cos(angle), np.sin(angle)])


def around_rad(action: float) -> float:
    """How far around the fixation target an action leads, positive to the robot's left."""
    return float(FINE_RAD * action + COARSE_RAD * action**3)
