"""What a policy is."""

from typing import Any, Protocol

import gymnasium as gym
import numpy as np

from sbm_gym.robot.knowledge import RobotKnowledge


class Policy(Protocol):
    """Chooses actions in a ``FixationEnv``, one episode at a time."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode.

        Args:
            env: the environment, just reset; policies may use its spaces and what its robot knows, never its ground
                truth.
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


class RobotPolicy:
    """Base of policies that decide by what the robot knows; they define ``act``, and ``start`` to keep anything else.

    Example:
        >>> import sbm_gym
        >>> class Forward(RobotPolicy):
        ...     def act(self, observation, info):
        ...         blocked = info["collided"] or self.robot.views_left % 5 == 0
        ...         return np.array([1.0, 0.0, float(blocked), 0.0], np.float32)
        >>> env, policy = gym.make("sbm_gym/IndoorBuiltin-v0"), Forward()
        >>> observation, info = env.reset(seed=0)
        >>> policy.reset(env, observation, info, np.random.default_rng(0))
        >>> policy.act(observation, info)
        array([1., 0., 1., 0.], dtype=float32)
    """

    robot: RobotKnowledge
    """What the robot knows in the running episode."""
    rng: np.random.Generator
    """The policy's only source of randomness."""

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""
        self.robot, self.rng = env.get_wrapper_attr("knowledge"), rng
        self.start(info)

    def start(self, info: dict[str, Any]) -> None:
        """Forgets the episode before; ``info`` is what ``env.reset`` returned."""
