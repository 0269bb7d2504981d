"""The ``next_best_view`` policy: greedy. It goes to the view with the highest utility, see
``agents.planning.view_planner``.
"""

from typing import Any

import numpy as np

from agents.planning.unmapped import Unmapped
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
UNMAPPED = "unmapped"
"""Values both, and plans on what it has seen and run into instead of the map."""


class NextBestView(RobotPolicy):
    """Compares the views within reach at every step."""

    def __init__(self, goal: str = "both") -> None:
        """Makes the policy.

        Args:
            goal: one of ``GOALS``, or ``UNMAPPED``.

        Raises:
            UsageError: if it is none of them.
        """
        if goal not in (*GOALS, UNMAPPED):
            raise UsageError(
                f"policy 'next_best_view:{goal}': must be one of {', '.join(GOALS)} (what it values) and {UNMAPPED}"
            )
        self._is_mapped, self._priorities = goal != UNMAPPED, GOALS.get(goal, DEFAULT_PRIORITIES)

    def start(self, info: dict[str, Any]) -> None:
        """Starts an episode."""
        self._unmapped = None if self._is_mapped else Unmapped(self.robot, info)
        self._planner = ViewPlanner(self._unmapped or self.robot, self.rng)

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A stride towards the best view, and the best look from there."""
        if self._unmapped is None:
            return self._planner.act(info, self._priorities)
        self._unmapped.update(info)
        action = self._planner.act(info, self._priorities)
        self._unmapped.note_action(action, info)
        return action
