"""Episodes without end, in scenes that come again and again: memory must stay flat, and closing must free it."""

import gc
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass

from experiments.benchmarks.scenes import proportional_mb

ENVS = ("sbm_gym/IndoorBuiltin-v0", "sbm_gym/OutdoorBuiltin-v0")
SCENES, SAMPLE_EVERY = 6, 50


@dataclass(frozen=True)
class Sample:
    """Memory at one moment."""

    resets: int
    """So far, in both worlds."""
    pss_mb: float
    """Proportional set size of this process."""


def soak(minutes: float, seed: int) -> Iterator[Sample]:
    """Plays a few random steps of an episode after each reset, in both worlds by turns.

    Yields:
        Memory after every ``SAMPLE_EVERY`` resets, from when all scenes have been visited; at last, once the
        environments are closed, with the number of resets in all.
    """
    import gymnasium as gym

    envs = [gym.make(f"sbm_gym:{env_id}", colours=False) for env_id in ENVS]
    for env in envs:
        env.unwrapped.scene_names = env.get_wrapper_attr("scene_names")[:SCENES]  # type: ignore[attr-defined]
        env.action_space.seed(seed)
    end, resets = time.monotonic() + 60.0 * minutes, 0
    while time.monotonic() < end or resets < 2 * SAMPLE_EVERY:
        env = envs[resets % len(envs)]
        env.reset(seed=seed + resets)
        for _ in range(5):
            env.step(env.action_space.sample())
        resets += 1
        if resets % SAMPLE_EVERY == 0:
            gc.collect()
            yield Sample(resets, proportional_mb(os.getpid()))
    for env in envs:
        env.close()
    envs.clear()
    del env
    gc.collect()
    yield Sample(resets, proportional_mb(os.getpid()))


def growth_mb_per_1000(samples: list[Sample]) -> float:
    """Slope of the straight line through memory over resets, from the second half of the samples on."""
    import numpy as np

    later = samples[len(samples) // 2 :]
    if len(later) < 2:
        return 0.0
    return float(np.polyfit([one.resets for one in later], [one.pss_mb for one in later], 1)[0]) * 1000.0
