"""The ``ppo`` policy: one that was trained by ``agents.train``."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.planning.prioritised_views import ACTION_SPACE, planner_of, priorities_of


class Ppo:
    """Takes the most likely action of a trained network."""

    def __init__(self, checkpoint: Path) -> None:
        """Reads a checkpoint.

        Args:
            checkpoint: its folder, or that of the run whose best policy is meant.

        Raises:
            SbmError: if there is none, or it is damaged.
        """
        from agents.network.checkpoint import checkpoint_folder, read_policy

        self._folder = checkpoint_folder(checkpoint)
        self._network, self.description = read_policy(self._folder)
        self._sets_priorities = self.description.get("hyperparameters", {}).get("env_wrapper") is not None

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``.

        Raises:
            UsageError: if the environment has other observations or actions than the one the policy was trained on.
        """
        from agents.network.checkpoint import check_spaces

        actions = ACTION_SPACE if self._sets_priorities else env.action_space
        check_spaces(self._folder, self.description, env.observation_space, actions)
        self._planner = planner_of(env) if self._sets_priorities else None

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """The most likely action."""
        action, _ = self._network.predict(observation, deterministic=True)
        return action if self._planner is None else self._planner.act(info, priorities_of(action))
