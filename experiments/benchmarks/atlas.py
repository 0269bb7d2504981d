"""Steps per second with a real detector in the loop: views looked up in an atlas, beside rendered and detected ones."""

import contextlib
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np

from experiments.benchmarks.rows import Row, log
from sbm_gym.build_atlas import AtlasConfig, build
from sbm_gym.registration import MAX_EPISODE_STEPS

ENV_ID = "sbm_gym/IndoorBuiltin-v0"
STEPS_A_SECOND = 500.0
"""What the project promises of ``compact``."""


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, per step with the resets between episodes, all in one scene.

    Args:
        quick: few steps, of the simulated detector.
    """
    detector = "simulated" if quick else "compact"
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        build(AtlasConfig(Path(folder), ENV_ID, scenes=1, detector=detector))
        log(f"the atlas of {detector} took {time.perf_counter() - started:.0f} s to build")
        with contextlib.closing(gym.make(ENV_ID, detector=detector, colours=False)) as env:
            drawn = seconds_per_step(env, 1 if quick else 2)
        with contextlib.closing(gym.make(ENV_ID, detector=detector, colours=False, atlas=folder)) as env:
            looked_up = seconds_per_step(env, 2 if quick else 20)
    yield Row(
        f"step on an atlas of {detector}, resets counted",
        f"the same with depth drawn and {detector} run",
        looked_up,
        drawn,
        f"{STEPS_A_SECOND:g} steps/s",
        None if quick else 1.0 / looked_up >= STEPS_A_SECOND,
        f"{1.0 / looked_up:.0f} steps/s",
    )


def seconds_per_step(env: gym.Env, episodes: int) -> float:
    """CPU seconds of a step in the first scene, in which an episode was played before."""
    scene = env.get_wrapper_attr("scene_names")[0]
    rng = np.random.default_rng(0)
    started = 0.0
    for episode in range(episodes + 1):
        if episode == 1:
            started = time.process_time()
        env.reset(seed=episode, options={"scene": scene})
        for _ in range(MAX_EPISODE_STEPS):
            env.step(rng.uniform(-1.0, 1.0, 4))
    return (time.process_time() - started) / (episodes * MAX_EPISODE_STEPS)
