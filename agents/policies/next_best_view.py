"""The ``next_best_view`` policy: greedy. It goes to the view that promises most information for the steps it costs, as
``agents.planning.view_planner`` says.
"""

from typing import Any

import gymnasium as gym
import numpy as np

from agents.planning.view_planner import DEFAULT, Priorities, ViewPlanner
from labeling.core.errors import UsageError

NOTHING = -np.inf
GOALS: dict[str, Priorities] = {
    "both": DEFAULT,
    "discovery": Priorities(sides=NOTHING),
    "diversity": Priorities(candidates=NOTHING, floor=NOTHING),
    "neither": Priorities(candidates=NOTHING, floor=NOTHING, sides=NOTHING),
}
"""What it values, by the terms of the environment's reward: ``discovery`` is of objects, ``diversity`` of their sides.
Where nothing within reach is worth anything it walks to unseen floor."""


class NextBestView:
    """Weighs the views within reach at every step."""

    def __init__(self, goal: str = "both") -> None:
        """Makes the policy.

        Args:
            goal: one of ``GOALS``.

        Raises:
            UsageError: if it is none of them.
        """
        if goal not in GOALS:
            raise UsageError(f"policy 'next_best_view:{goal}': what it values must be one of {', '.join(GOALS)}")
        self._priorities = GOALS[goal]

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""
        self._planner = ViewPlanner(env.unwrapped, rng)

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A stride towards the best view, and the best look from there."""
        return self._planner.act(info, self._priorities)
