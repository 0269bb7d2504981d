"""The ``ppo`` policy: one that was trained by ``agents.train``."""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from agents.planning import choices, promises
from labeling.core.errors import SbmError


class Ppo:
    """Takes the most likely action of a trained network, or draws one as in training."""

    def __init__(self, checkpoint: Path, sampled: bool = False) -> None:
        """Reads a checkpoint.

        Args:
            checkpoint: its folder, or that of the run whose best policy is meant.
            sampled: draw actions by their probabilities.

        Raises:
            SbmError: if there is none, it is damaged, or of a version with other actions.
        """
        from agents.network.checkpoint import checkpoint_folder, read_policy

        self._folder, self._sampled = checkpoint_folder(checkpoint), sampled
        self._network, self.description = read_policy(self._folder)
        wrapper = self.description.get("hyperparameters", {}).get("env_wrapper")
        if wrapper not in (None, *promises.WITHOUT):
            raise SbmError(f"{self._folder}: its actions are those of {wrapper!r}, which this version does not know")
        self._wrapper: str | None = wrapper

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``.

        Raises:
            UsageError: if the environment has other observations or actions than the one the policy was trained on.
        """
        from agents.network.checkpoint import check_spaces

        observations, actions = env.observation_space, env.action_space
        if self._wrapper:
            observations = promises.observation_space(observations, self._wrapper)
            actions = choices.ACTION_SPACE
        check_spaces(self._folder, self.description, observations, actions)
        self._robot = None
        if self._wrapper:
            self._robot = promises.knowledge_for(self._wrapper, env.get_wrapper_attr("knowledge"), info)
        self._rng = rng

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """The most likely action, or one that is drawn."""
        if self._robot is not None and self._wrapper is not None:
            observation = promises.with_promises(observation, info, self._robot, self._wrapper)
        seen = {name: observation[name] for name in self.description["observation_space"]["spaces"]}
        action = self._draw(seen) if self._sampled else self._network.predict(seen, deterministic=True)[0]
        if self._robot is not None:
            return choices.chosen_action(action, info, self._robot)
        return action

    def _draw(self, seen: dict[str, np.ndarray]) -> np.ndarray:
        import torch

        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(self._rng.integers(2**63)))
            return self._network.predict(seen, deterministic=False)[0]
