"""Actions that name a place to go to: the robot drives a stride on the shortest way there, as the ``ring`` policy does.

A policy that learns need not learn to steer around furniture then, for which the map is enough, only where to go. An
action of zero goes on around the fixation target, to the nearest sector that it could be seen from and has not been;
where none is left, another confirmed object that has some becomes the fixation target. What is learnt is when and how
to do otherwise (residual policy learning: Silver et al. 2018; Johannink et al. 2019).

| | action | meaning |
|---|---|---|
| 0 | with a fixation target | distance from it: -1 is the inner, 1 the outer edge of the ring, and a bit beyond |
| 1 | with a fixation target | how far from that sector: 30 a + 120 a^3 degrees around, positive is the robot's left |
| 0, 1 | without | ahead and left of the robot, 1 is six strides |
| 2 | | gaze yaw: a stands for the environment's own a |a|, so that trying things out rarely loses the target |
| 3 | | gaze pitch: a stands for the environment's own 0.4 a |

Places that the robot cannot stand at stand for the nearest one that it can. Every step may name another place.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float, Float32

from agents.paths import advance
from agents.steering import bearing_rad, move_action, wrap
from sbm_gym.object_memory import KnownObject

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


def towards(env: Any, info: dict[str, Any], action: Float[np.ndarray, "4"]) -> Float32[np.ndarray, "4"]:
    """The environment's own action for one that names a place; may choose another fixation target.

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
    return np.array([*move, action[2] * abs(action[2]), PITCH_SHARE * action[3]], np.float32)


def place_m(env: Any, info: dict[str, Any], action: Float[np.ndarray, "4"]) -> Float[np.ndarray, "2"]:
    """The place that an action names, world axes; may choose another fixation target."""
    agent, position_m = info["agent"], info["agent"]["position_m"]
    if not info["fixation_target"]:
        cos, sin = np.cos(agent["yaw_rad"]), np.sin(agent["yaw_rad"])
        ahead, left = action[:2] * FAR_STRIDES * env.stride_m
        return position_m + np.array([cos * ahead - sin * left, sin * ahead + cos * left])
    target, angle_rad = next_side(env, position_m)
    low_m, high_m = env.profile.ring_m
    low_m, high_m = (1.0 - RING_MARGIN) * low_m, (1.0 + RING_MARGIN) * high_m
    distance_m = low_m + 0.5 * (action[0] + 1.0) * (high_m - low_m)
    # Who faces the middle and steps to its left goes round clockwise, seen from above.
    angle_rad -= around_rad(action[1])
    return target.centroid_m[:2] + distance_m * np.array([np.cos(angle_rad), np.sin(angle_rad)])


def next_side(env: Any, position_m: Float[np.ndarray, "2"]) -> tuple[KnownObject, float]:
    """Where to go on: the object to circle, which becomes the fixation target, and the direction from it.

    Args:
        env: the unwrapped environment; something has been confirmed.
        position_m: where the robot is.
    """
    target = env.episode.target
    others = [known for known in env.memory.objects if known is not target]
    others.sort(key=lambda known: float(np.linalg.norm(known.centroid_m[:2] - position_m)))
    for known in (target, *others):
        here_rad = bearing_rad(known.centroid_m[:2], position_m)
        sectors = sectors_left(env, known)
        if sectors:
            if known is not target:
                env.fixate(known.object_id)
            middles_rad = (np.array(sectors) + 0.5) * (2.0 * np.pi / env.num_azimuths)
            return known, float(middles_rad[int(np.argmin(np.abs(wrap(middles_rad - here_rad))))])
    # Everything has been seen: on around the target all the same.
    return target, bearing_rad(target.centroid_m[:2], position_m) - FINE_RAD


def sectors_left(env: Any, known: KnownObject) -> list[int]:
    """The sectors that an object could be seen from, and from which the robot has neither seen it nor tried to."""
    done = known.azimuths | {cell[0] for cell in env.episode.looked.tried(known.object_id)}
    return [sector for sector in np.flatnonzero(env.episode.open_sectors(known)).tolist() if sector not in done]


def around_rad(action: float) -> float:
    """How far around the fixation target an action leads, positive to the robot's left."""
    return float(FINE_RAD * action + COARSE_RAD * action**3)
