"""The ``random`` policy: actions drawn evenly from the action space."""

from typing import Any

import gymnasium as gym
import numpy as np


class RandomWalk:
    """Wanders about and looks around without a plan."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""
        self._rng = rng

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """Four independent uniform numbers."""
        return self._rng.uniform(-1.0, 1.0, 4).astype(np.float32)
