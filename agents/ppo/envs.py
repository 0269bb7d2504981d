"""The environments of training: what is paid, which scenes each worker has, several of them side by side."""

import functools
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from agents.ppo.config import PaidReward
from agents.ppo.hyperparameters import ENV_WRAPPERS
from agents.rollouts import environments
from agents.rollouts.episode_statistics import EpisodeStatistics
from labeling.runtime.interrupts import hold_back_interrupts
from labeling.runtime.threads import threads_of_children
from sbm_gym.env.rewards import RewardWeights

WITHOUT_DISCOVERY = {"new_object": 0.0, "better_view": 0.0}
WITHOUT_DIVERSITY = {"new_azimuth": 0.0, "new_range_or_elevation": 0.0}
REWARDS: dict[str, RewardWeights] = {
    "both": RewardWeights(),
    "discovery": RewardWeights(**WITHOUT_DIVERSITY),
    "diversity": RewardWeights(**WITHOUT_DISCOVERY),
    "neither": RewardWeights(**WITHOUT_DISCOVERY, **WITHOUT_DIVERSITY),
}


@dataclass(frozen=True)
class EnvConfig:
    """Which environment; plain values, so that it can be sent to workers."""

    env: str
    """Gymnasium id."""
    detector: str = "simulated"
    reward: PaidReward = "both"
    colours: bool = True
    """Whether observed pictures have colours; without, steps are faster."""
    wrapper: str | None = None
    """One of ``ENV_WRAPPERS``, which changes what actions mean."""


class CompleteEpisodes(gym.Wrapper):
    """Terminates episodes instead of truncating them, and hands on their statistics instead of the ``info`` of steps.

    The end of an episode is the end of the task: the views are counted, and the observation says how many are left. So
    the value of what would come after is zero, and the last step is handed on as terminated; a truncated one would have
    Stable-Baselines3 add the value of going on.

    The ``info`` of steps holds masks and clouds, which nobody in training reads: it stays here.
    """

    def __init__(self, env: gym.Env) -> None:
        """Wraps an environment with the ``info`` of ``FixationEnv``."""
        super().__init__(env)
        self._statistics = EpisodeStatistics()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode."""
        observation, _ = self.env.reset(seed=seed, options=options)
        self._statistics = EpisodeStatistics()
        return observation, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step; the ``info`` of the last one holds ``episode_statistics``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._statistics.add(float(reward), info)
        ended = terminated or truncated
        last = {"episode_statistics": self._statistics.result()} if ended else {}
        return observation, float(reward), ended, False, last


class ShareOfScenes(gym.Wrapper):
    """Draws the scene of every episode from a share of the scenes, so that no two workers build the same one.

    To build a scene takes as long as some hundred steps, and while one worker builds all others wait. Once built, it is
    opened from disk.
    """

    def __init__(self, env: gym.Env, scenes: tuple[str, ...]) -> None:
        """Wraps an environment that takes the option ``scene``."""
        super().__init__(env)
        self._scenes = scenes
        self._rng = np.random.default_rng()

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode in one of the scenes."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        scene = self._scenes[int(self._rng.integers(len(self._scenes)))]
        return self.env.reset(seed=seed, options={"scene": scene, **(options or {})})


def make_env(config: EnvConfig, split: str) -> gym.Env:
    """An environment as it is, but for its wrapper.

    Raises:
        UsageError: if there is no such environment, or a setting makes no sense to it.
    """
    env = environments.make_env(
        config.env,
        split,
        config.detector,
        reward_weights=REWARDS[config.reward],
        **({} if config.colours else {"colours": False}),
    )
    return env if config.wrapper is None else ENV_WRAPPERS[config.wrapper](env)


def make_training_env(config: EnvConfig, index: int, count: int, scenes: tuple[str, ...] | None = None) -> gym.Env:
    """The training environment of one of several workers.

    Args:
        config: which environment.
        index: number of the worker, from 0.
        count: how many there are.
        scenes: what they share; by default all training scenes, if the environment has any by name.
    """
    env = make_env(config, "train")
    if scenes is None and env.has_wrapper_attr("scene_names"):
        scenes = env.get_wrapper_attr("scene_names")
    return CompleteEpisodes(env if scenes is None else ShareOfScenes(env, share(scenes, index, count)))


def share(scenes: tuple[str, ...], index: int, count: int) -> tuple[str, ...]:
    """The scenes of one of several workers: every scene has one worker, unless there are more workers than scenes."""
    return scenes if len(scenes) < count else scenes[index::count]


def make_vec_env(config: EnvConfig, count: int) -> VecEnv:
    """Several environments that step side by side; a single one steps in this process."""
    if count == 1:
        return DummyVecEnv([functools.partial(make_training_env, config, 0, 1)])
    return make_subproc_vec_env(config, count)


def make_subproc_vec_env(config: EnvConfig, count: int, scenes: tuple[str, ...] | None = None) -> VecEnv:
    """Several environments, each in a process and a thread of its own; arguments as of ``make_training_env``."""
    factories = [functools.partial(make_training_env, config, index, count, scenes) for index in range(count)]
    with threads_of_children(1), hold_back_interrupts():
        return SubprocVecEnv(factories, start_method="spawn")
