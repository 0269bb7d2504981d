"""The environments of training: what is paid, what is seen, which scenes each has, many of them side by side."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np
from gymnasium.wrappers import FilterObservation
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from agents.ppo.config import PaidReward
from agents.ppo.hyperparameters import ENV_WRAPPERS
from agents.ppo.vec_env import GroupedVecEnv, ProcessGroup
from agents.rollouts.episode_statistics import EpisodeStatistics
from agents.rollouts.scene_shares import SHARED_SPLIT, scenes_to_compare_in
from labeling.core.errors import UsageError
from labeling.runtime.interrupts import hold_back_interrupts
from labeling.runtime.threads import threads_of_children
from sbm_gym import named_env
from sbm_gym.env.rewards import RewardWeights

Item = TypeVar("Item")
WITHOUT_DISCOVERY = {"new_object": 0.0, "better_view": 0.0}
WITHOUT_DIVERSITY = {"new_azimuth": 0.0, "new_range_or_elevation": 0.0}
REWARDS: dict[str, RewardWeights] = {
    "both": RewardWeights(),
    "discovery": RewardWeights(**WITHOUT_DIVERSITY),
    "diversity": RewardWeights(**WITHOUT_DISCOVERY),
    "neither": RewardWeights(**WITHOUT_DISCOVERY, **WITHOUT_DIVERSITY),
}


EPISODES_PER_SCENE = 8
"""So many episodes in a row are in the same scene: to open another one takes as long as some of them."""


@dataclass(frozen=True)
class EnvConfig:
    """Which environment; plain values, so that it can be sent to workers."""

    env: str
    """Gymnasium id."""
    detector: str = "simulated"
    reward: PaidReward = "both"
    keys: tuple[str, ...] = ("rgb", "depth", "state")
    """Parts of observations that are handed on; without "rgb" pictures have no colours, and steps are faster."""
    wrapper: str | None = None
    """One of ``ENV_WRAPPERS``, which changes what actions mean."""
    atlas: str | None = None
    """Folder of ``sbm_gym.build_atlas`` to look views up in."""
    scenes: int = 120
    """The first so many of the endless split are for training,"""
    validation_scenes: int = 20
    """and so many after them for validation."""


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


class NumberedEpisodes(gym.Wrapper):
    """Begins every episode as its number and the seed say, whatever went before, in a share of the training scenes.

    So a run that goes on plays what it would have played. No two environments have the same scene: to open one takes as
    long as some hundred steps.
    """

    def __init__(self, env: gym.Env, scenes: Sequence[str]) -> None:
        """Wraps an environment.

        Args:
            env: takes the option ``scene``, if there are any.
            scenes: to draw from; none leaves it to the environment.
        """
        super().__init__(env)
        self._scenes = scenes
        self._seed = self._number = 0

    def begin_at(self, number: int) -> None:
        """The next episode is that of the number."""
        self._number = number

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts the next episode; a seed is that of all episodes from now on."""
        self._seed = self._seed if seed is None else seed
        chosen: dict[str, Any] = {}
        if self._scenes:
            drawn = np.random.default_rng([self._seed, 0, self._number // EPISODES_PER_SCENE])
            chosen["scene"] = self._scenes[int(drawn.integers(len(self._scenes)))]
        episode_seed = np.random.SeedSequence([self._seed, 1, self._number]).generate_state(1)
        self._number += 1
        return self.env.reset(seed=int(episode_seed[0]), options={**chosen, **(options or {})})


def make_env(config: EnvConfig, scene_cache: int = 1) -> gym.Env:
    """An environment as policies in training see it: observations and actions are those of the network.

    Args:
        config: which environment.
        scene_cache: how many scenes it keeps open.

    Raises:
        UsageError: if there is no such environment, a setting makes no sense to it, or its observations lack what the
            policy looks at.
    """
    settings: dict[str, Any] = {} if "rgb" in config.keys else {"colours": False}
    if config.atlas is not None:
        settings["atlas"] = config.atlas
    if config.reward == "evidence":
        settings["reward"] = "evidence"
    weights = REWARDS.get(config.reward)
    env = named_env.make_env(
        config.env, "endless", config.detector, reward_weights=weights, scene_cache=scene_cache, **settings
    )
    if config.wrapper is not None:
        if not env.has_wrapper_attr("state_names"):
            env.close()
            raise UsageError(
                f"env {config.env!r}: env_wrapper {config.wrapper} goes with worlds of this project; give "
                "--hyperparams with another"
            )
        env = ENV_WRAPPERS[config.wrapper](env)
    if missing := [name for name in config.keys if name not in env.observation_space.spaces]:  # type: ignore[attr-defined]
        env.close()
        raise UsageError(
            f"the policy looks at {', '.join(missing)}, which observations of {config.env} with env_wrapper "
            f"{config.wrapper or 'none'} do not have; ChoicePolicy goes with env_wrapper {' or '.join(ENV_WRAPPERS)}"
        )
    return FilterObservation(env, config.keys)


def training_scenes(env: gym.Env, config: EnvConfig) -> tuple[str, ...]:
    """Names of the scenes to train in; none if the environment has none by name."""
    return _scene_names(env)[: config.scenes]


def validation_scenes(env: gym.Env, config: EnvConfig) -> tuple[str, ...]:
    """Names of the scenes to validate in; none if the environment has none by name.

    None of them is trained in, and none is one that policies are compared in: of a world that has few scenes they are
    fewer than asked for.

    Raises:
        UsageError: if training leaves none.
    """
    names = _scene_names(env)
    # On an atlas few scenes have views, and policies are compared in the world itself.
    compared = 0 if config.atlas is not None or not names else len(scenes_to_compare_in(SHARED_SPLIT, names))
    free = names[: len(names) - compared]
    if names and len(free) <= config.scenes:
        where = "" if config.atlas is None else f" in {config.atlas}"
        kept = f", the last {compared} of which are for comparing policies" if compared else ""
        raise UsageError(
            f"--scenes {config.scenes} leaves none to validate in: there are {len(names)} scenes{where}{kept}; "
            "give fewer"
        )
    return free[config.scenes : config.scenes + config.validation_scenes]


def _scene_names(env: gym.Env) -> tuple[str, ...]:
    return env.get_wrapper_attr("scene_names") if env.has_wrapper_attr("scene_names") else ()


def make_training_env(config: EnvConfig, index: int, count: int) -> gym.Env:
    """One of several training environments.

    Args:
        config: which environment.
        index: its number, from 0.
        count: how many there are.
    """
    env = make_env(config)
    return CompleteEpisodes(NumberedEpisodes(env, share(training_scenes(env, config), index, count)))


def share(scenes: Sequence[str], index: int, count: int) -> Sequence[str]:
    """The scenes of one of several environments; no other one has them unless there are fewer scenes than these."""
    return scenes if len(scenes) < count else scenes[index::count]


def make_vec_env(config: EnvConfig, count: int, processes: int) -> VecEnv:
    """Several environments, in this process or spread over others, each of these in a thread of its own.

    Args:
        config: which environment.
        count: how many of it.
        processes: over how many they are spread; 1 steps them here.
    """
    factories = env_factories(config, count)
    if processes == 1:
        return DummyVecEnv(factories)  # type: ignore[arg-type]
    parts = spread(factories, processes)
    with threads_of_children(1), hold_back_interrupts():
        return GroupedVecEnv([ProcessGroup(part) for part in parts], [len(part) for part in parts])


def env_factories(config: EnvConfig, count: int) -> list[Callable[[], gym.Env]]:
    """What makes each of several training environments; picklable."""
    return [functools.partial(make_training_env, config, index, count) for index in range(count)]


def spread(items: Sequence[Item], groups: int) -> list[Sequence[Item]]:
    """Neighbouring items in groups of much the same size, none of which is empty."""
    parts = np.array_split(np.arange(len(items)), min(groups, len(items)))
    return [items[int(part[0]) : int(part[-1]) + 1] for part in parts]
