"""The ``next_best_view`` policy: greedy. It goes to the view that promises most information for the steps it costs, as
``agents.view_planner`` says.
"""

from typing import Any

import gymnasium as gym
import numpy as np

from agents.view_planner import ViewPlanner


class NextBestView:
    """Weighs the views within reach at every step."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""
        self._planner = ViewPlanner(env.unwrapped, rng)

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A stride towards the best view, and the best look from there."""
        return self._planner.act(info)
