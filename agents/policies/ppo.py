"""The ``ppo`` policy: one that was trained by ``agents.train``."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.planning.prioritised_views import ACTION_SPACE, planner_of, priorities_of


class Ppo:
    """Takes the most likely action of a trained network."""

    def __init__(self, checkpoint: Path, deterministic: bool = True) -> None:
        """Reads a checkpoint.

        Args:
            checkpoint: its folder, or that of the run whose best policy is meant.
            deterministic: False draws actions, as in training.

        Raises:
            SbmError: if there is none, or it is damaged.
        """
        from agents.network.checkpoint import checkpoint_folder, read_policy

        self._folder = checkpoint_folder(checkpoint)
        self._network, self.description = read_policy(self._folder)
        self._sets_priorities = self.description.get("hyperparameters", {}).get("env_wrapper") is not None
        self._deterministic = deterministic

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
        self._rng = rng
        self._low, self._high = actions.low, actions.high  # type: ignore[attr-defined]

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """The most likely action, or one that is drawn."""
        action = self._choose(observation)
        return action if self._planner is None else self._planner.act(info, priorities_of(action))

    def _choose(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        import torch

        if self._deterministic:
            return self._network.predict(observation, deterministic=True)[0]
        with torch.no_grad():
            batch, _ = self._network.obs_to_tensor(observation)
            normal = self._network.get_distribution(batch).distribution
            mean, deviation = normal.mean[0].numpy(), normal.stddev[0].numpy()  # type: ignore[union-attr]
        action = mean + deviation * self._rng.standard_normal(mean.shape)
        return np.clip(action, self._low, self._high).astype(np.float32)
