"""What a policy is."""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np


class Policy(Protocol):
    """Chooses actions in a ``FixationEnv``, one episode at a time."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode.

        Args:
            env: the environment, just reset; policies may use its map and settings, never its ground truth.
            observation: what ``env.reset`` returned.
            info: likewise.
            rng: the policy's only source of randomness.
        """
        ...

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """The next action.

        Args:
            observation: the latest observation.
            info: that came with it.
        """
        ...
