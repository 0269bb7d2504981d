"""The ``ppo`` policy: one that was trained by ``agents.train``."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.planning import moves_and_looks
from labeling.core.errors import SbmError


class Ppo:
    """Takes the most likely action of a trained network."""

    def __init__(self, checkpoint: Path) -> None:
        """Reads a checkpoint.

        Args:
            checkpoint: its folder, or that of the run whose best policy is meant.

        Raises:
            SbmError: if there is none, it is damaged, or of a version with other actions.
        """
        from agents.network.checkpoint import checkpoint_folder, read_policy

        self._folder = checkpoint_folder(checkpoint)
        self._network, self.description = read_policy(self._folder)
        wrapper = self.description.get("hyperparameters", {}).get("env_wrapper")
        if wrapper not in (None, "moves_and_looks"):
            raise SbmError(f"{self._folder}: its actions are those of {wrapper!r}, which this version does not know")
        self._chooses = wrapper is not None

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``.

        Raises:
            UsageError: if the environment has other observations or actions than the one the policy was trained on.
        """
        from agents.network.checkpoint import check_spaces

        observations, actions = env.observation_space, env.action_space
        if self._chooses:
            observations, actions = moves_and_looks.observation_space(observations), moves_and_looks.ACTION_SPACE
        check_spaces(self._folder, self.description, observations, actions)
        self._robot = env.get_wrapper_attr("knowledge") if self._chooses else None

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """The most likely action."""
        if self._robot is not None:
            observation = moves_and_looks.with_promises(observation, info, self._robot)
        seen = {name: observation[name] for name in self.description["observation_space"]["spaces"]}
        action, _ = self._network.predict(seen, deterministic=True)
        if self._robot is not None:
            return moves_and_looks.chosen_action(action, info, self._robot)
        return action
