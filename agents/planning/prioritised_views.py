"""Actions that set priorities of the view planner, which then plans the next move and look.

A policy that learns need not learn then how to steer around furniture, what hides what, and which sides of an object
have been seen, for which the map and memory are enough, only what to go for when. An action of zero is the
``next_best_view`` policy; what is learnt is when and how to do otherwise (residual policy learning: Silver et al. 2018;
Johannink et al. 2019).

| | action: 1 is times 4.5, -1 divides by as much |
|---|---|
| 0 | the gain of views of unconfirmed candidates |
| 1 | of unseen floor |
| 2 | of the fixation target |
| 3 | from new ranges and elevations in sectors that have been seen |
| 4 | the nearest views of objects and candidates; the farthest, the other way round |
| 5 | how many steps away a view may be (patience) |
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from agents.planning.view_planner import Priorities, ViewPlanner

STRENGTH = 1.5
"""Exponent that an action of 1 stands for."""
ACTION_SPACE = spaces.Box(-1.0, 1.0, (6,), np.float32)
DRAW_SEED = 0
"""Every episode draws the places to compare from the same numbers: the action alone decides."""


class PrioritisedViews(gym.Wrapper):
    """An environment whose actions are priorities of the planner that moves the robot."""

    def __init__(self, env: gym.Env) -> None:
        """Wraps a ``FixationEnv``."""
        super().__init__(env)
        self.action_space = ACTION_SPACE

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
    return ViewPlanner(env.get_wrapper_attr("knowledge"), np.random.default_rng(DRAW_SEED))


def priorities_of(action: Float[np.ndarray, "6"]) -> Priorities:
    """What an action means; values beyond [-1, 1] are clipped."""
    return Priorities(*(STRENGTH * np.clip(np.asarray(action, float), -1.0, 1.0)).tolist())
