"""How good a policy is on validation scenes: the same starts every time, and always the full reward."""

from collections.abc import Callable

import gymnasium as gym
from stable_baselines3.common.policies import ActorCriticPolicy

from agents.ppo.episode_figures import EpisodeFigures, means

FIRST_SEED = 1_000_000
"""Seeds of validation episodes count up from here, whatever the seed of the run: all runs are measured alike."""


def validate(
    policy: ActorCriticPolicy, env: gym.Env, episodes: int, given_up: Callable[[], bool] = lambda: False
) -> dict[str, float] | None:
    """Figures of a policy that always takes its most likely action.

    Args:
        policy: the policy.
        env: the environment, with validation scenes.
        episodes: how many.
        given_up: asked after every episode whether there is no more time.

    Returns:
        Means over the episodes by name, None if given up.
    """
    policy.set_training_mode(False)
    done = []
    for number in range(episodes):
        observation, _ = env.reset(seed=FIRST_SEED + number)
        figures, ended = EpisodeFigures(), False
        while not ended:
            action, _ = policy.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, info = env.step(action)
            figures.add(float(reward), info)
            ended = terminated or truncated
        done.append(figures.figures())
        if given_up():
            return None
    return means(done)
