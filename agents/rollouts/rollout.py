"""One episode of one policy, step by step."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from agents.policies.base import Policy


@dataclass(frozen=True)
class Transition:
    """What one step did."""

    action: np.ndarray
    reward: float
    info: dict[str, Any]
    """After the step."""


def rollout(
    env: gym.Env, policy: Policy, observation: dict[str, np.ndarray], info: dict[str, Any], rng: np.random.Generator
) -> Iterator[Transition]:
    """Has a policy act until the episode ends.

    Args:
        env: the environment, just reset.
        policy: who acts.
        observation: what ``env.reset`` returned.
        info: likewise.
        rng: the policy's only source of randomness.

    Yields:
        The steps; between two of them the environment may be asked for whatever it shows.
    """
    policy.reset(env, observation, info, rng)
    ended = False
    while not ended:
        action = policy.act(observation, info)
        observation, reward, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
        yield Transition(action, float(reward), info)
