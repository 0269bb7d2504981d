"""The environment whose actions are choices: a move and a look of a few, each told of by what it promises."""

from typing import Any

import gymnasium as gym

from agents.planning.choices import ACTION_SPACE, chosen_action
from agents.planning.promises import knowledge_for, observation_space, with_promises


class MovesAndLooks(gym.Wrapper):
    """An environment whose actions are a move and a look of ``ACTION_SPACE``."""

    def __init__(self, env: gym.Env, name: str = "moves_and_looks") -> None:
        """Wraps an environment with a ``FixationEnv`` inside.

        Args:
            env: the environment.
            name: one of ``WITHOUT``.
        """
        super().__init__(env)
        self._name = name
        self.action_space, self.observation_space = ACTION_SPACE, observation_space(env.observation_space, name)
        self._info: dict[str, Any] = {}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        observation, self._info = self.env.reset(seed=seed, options=options)
        self._robot = knowledge_for(self._name, self.env.get_wrapper_attr("knowledge"), self._info)
        return with_promises(observation, self._info, self._robot, self._name), self._info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Moves and looks."""
        chosen = chosen_action(action, self._info, self._robot)
        observation, reward, terminated, truncated, self._info = self.env.step(chosen)
        promised = with_promises(observation, self._info, self._robot, self._name)
        return promised, reward, terminated, truncated, self._info
