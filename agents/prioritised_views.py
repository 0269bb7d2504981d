"""Actions that set priorities: the view planner weighs the views within reach by them, and the robot goes and looks.

A policy that learns need not learn then how to steer around furniture, what hides what, and which sides of an object
have been seen, for which the map and memory are enough, only what to go for when. An action of zero is the
``next_best_view`` policy; what is learnt is when and how to do otherwise (residual policy learning: Silver et al. 2018;
Johannink et al. 2019).

| | action: 1 is times 4.5, -1 divides by as much |
|---|---|
| 0 | what there is to see from places ahead of the robot's camera; behind it, the other way round |
| 1 | from places to its left; to its right, the other way round |
| 2 | what unconfirmed candidates and unseen floor promise |
| 3 | what new views of the fixation target promise |
"""

from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from agents.view_planner import Priorities, ViewPlanner

STRENGTH = 1.5
"""Exponent that an action of 1 stands for."""
DRAW_SEED = 0
"""Every episode draws the places to weigh from the same numbers: the action alone decides."""


class PrioritisedViews(gym.Wrapper):
    """An environment whose actions are priorities of the planner that moves the robot."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        observation, self._info = self.env.reset(seed=seed, options=options)
        self._planner = planner_of(self.env)
        return observation, self._info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step; see the module."""
        move = self._planner.act(self._info, priorities_of(action))
        observation, reward, terminated, truncated, self._info = self.env.step(move)
        return observation, reward, terminated, truncated, self._info


def planner_of(env: gym.Env) -> ViewPlanner:
    """The planner of the episode that an environment has just begun."""
    return ViewPlanner(env.unwrapped, np.random.default_rng(DRAW_SEED))


def priorities_of(action: Float[np.ndarray, "4"]) -> Priorities:
    """What an action means; values beyond [-1, 1] are clipped."""
    ahead, left, explore, focus = STRENGTH * np.clip(np.asarray(action, float), -1.0, 1.0)
    return Priorities(float(ahead), float(left), float(explore), float(focus))
