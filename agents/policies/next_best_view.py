"""The ``next_best_view`` policy: greedy. It goes to the view with the highest utility, see
``agents.planning.view_planner``.
"""

from typing import Any

import numpy as np

from agents.planning.view_planner import DEFAULT_PRIORITIES, Priorities, ViewPlanner
from agents.policies.base import RobotPolicy
from labeling.core.errors import UsageError

NOTHING = 0.0
GOALS: dict[str, Priorities] = {
    "both": DEFAULT_PRIORITIES,
    "discovery": Priorities(sides=NOTHING),
    "diversity": Priorities(candidates=NOTHING, floor=NOTHING),
    "neither": Priorities(candidates=NOTHING, floor=NOTHING, sides=NOTHING),
}
"""What it values, by the terms of the environment's reward: ``discovery`` is of objects, ``diversity`` of their sides.
Where no view within reach has any gain it walks to unseen floor."""


class NextBestView(RobotPolicy):
    """Compares the views within reach at every step."""

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

    def start(self, info: dict[str, Any]) -> None:
        """Starts an episode."""
        self._planner = ViewPlanner(self.robot, self.rng)

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A stride towards the best view, and the best look from there."""
        return self._planner.act(info, self._priorities)
