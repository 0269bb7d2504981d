"""How good a policy is on validation scenes: the same starts every time, and always the full reward."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.policies import ActorCriticPolicy

from agents.policies.base import Policy
from agents.rollouts.episode_statistics import EpisodeStatistics, means
from agents.rollouts.rollout import rollout

FIRST_SEED = 1_000_000
"""Seeds of validation episodes count up from here, whatever the seed of the run: all runs are measured alike."""


class MostLikelyAction:
    """The policy that always takes the most likely action of a network in training."""

    def __init__(self, network: ActorCriticPolicy) -> None:
        """Wraps a network, and puts it out of its training mode."""
        network.set_training_mode(False)
        self._network = network

    def reset(
        self, env: gym.Env, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
    ) -> None:
        """Starts an episode; see ``Policy``."""

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """The most likely action."""
        return self._network.predict(observation, deterministic=True)[0]


def validate(
    policy: Policy,
    env: gym.Env,
    episodes: int,
    given_up: Callable[[], bool] = lambda: False,
    scenes: Sequence[str] = (),
) -> dict[str, float] | None:
    """Statistics of a policy on validation episodes.

    Args:
        policy: who acts.
        env: the environment, with validation scenes.
        episodes: how many.
        given_up: asked after every episode whether there is no more time.
        scenes: where they are, spread evenly over these; none leaves it to the environment.

    Returns:
        Means over the episodes by name, None if given up.
    """
    done = []
    for number in range(episodes):
        done.append(play(policy, env, number, scenes[number * len(scenes) // episodes] if scenes else None))
        if given_up():
            return None
    return means(done)


def play(policy: Policy, env: gym.Env, number: int, scene: str | None) -> dict[str, float]:
    """Statistics of one validation episode.

    Args:
        policy: who acts.
        env: the environment.
        number: of the episode: decides where it starts.
        scene: where it is; None leaves it to the environment.
    """
    observation, info = env.reset(seed=FIRST_SEED + number, options=None if scene is None else {"scene": scene})
    statistics = EpisodeStatistics()
    for step in rollout(env, policy, observation, info, np.random.default_rng([number])):
        statistics.add(step.reward, step.info)
    return statistics.result()
