"""Steps per second of the environment: beside ``mujoco.Renderer`` in the same scene, with workers, and with PPO."""

import contextlib
import os
import time
from collections.abc import Iterator
from dataclasses import replace

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from experiments.benchmarks.render import BASELINE, baseline
from experiments.benchmarks.rows import Row, log, median_seconds
from sbm_gym.registration import MAX_EPISODE_STEPS

ENV_ID = "sbm_gym/IndoorBuiltin-v0"
SCENE = "train/00"
WORKERS = (1, 2, 4)
STEPS_PER_CORE = 60.0
"""What the project promises, a second, with the simulated detector."""
SIZE_PX = 84


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, per step; all in one scene that has been built already.

    Args:
        quick: few steps.
    """
    yield from _in_one_scene(quick)
    for colours in (True, False):
        yield from _with_workers(quick, colours)
    yield from _learning(quick)


def _in_one_scene(quick: bool) -> Iterator[Row]:
    """A step with all that belongs to it, beside the mere pictures of the same views; and one without colours."""
    import sbm_gym  # noqa: F401, registers the environments

    episodes = 1 if quick else 5
    with contextlib.closing(gym.make(ENV_ID)) as env:
        seconds, cameras = _step(env, episodes)
        scene = env.get_wrapper_attr("scene")
        log(f"{SCENE}: {len(scene.world.objects)} objects")
        views = cameras[:: MAX_EPISODE_STEPS // 3]
        draw = baseline(scene.whole_model(), scene.whole_data(), views, SIZE_PX, False, True)
        theirs = median_seconds(draw, 1 if quick else 3) / len(views)
    what = f"step at {SIZE_PX}x{SIZE_PX}: move, picture with shadows, simulated detector, memory, reward"
    yield Row(what, f"{BASELINE}: the picture only", seconds, theirs)
    with contextlib.closing(gym.make(ENV_ID, colours=False)) as env:
        without, _ = _step(env, episodes)
    yield Row("  the same without colours: depth and ids only", "step with colours", without, seconds)


def _step(env: gym.Env, episodes: int) -> tuple[float, list[Float[np.ndarray, "4 4"]]]:
    """Seconds of a step, the median over episodes in the scene, and the cameras of all steps."""
    env.reset(seed=0, options={"scene": SCENE})
    rng = np.random.default_rng(0)
    seconds, cameras = [], []
    for _ in range(episodes):
        env.reset(options={"reuse_scene": True})
        started = time.perf_counter()
        for _ in range(MAX_EPISODE_STEPS):
            *_, info = env.step(rng.uniform(-1.0, 1.0, 4))
            cameras.append(info["agent"]["camera_to_world"].copy())
        seconds.append((time.perf_counter() - started) / MAX_EPISODE_STEPS)
    return float(np.median(seconds)), cameras


def _with_workers(quick: bool, colours: bool) -> Iterator[Row]:
    """Steps of several workers side by side in one scene, ends of episodes included; each worker has one thread."""
    from agents.ppo.envs import EnvConfig, make_vec_env

    steps = MAX_EPISODE_STEPS * (1 if quick else 12)
    rng = np.random.default_rng(0)
    alone = None
    for count in WORKERS:
        config = EnvConfig(ENV_ID, keys=("rgb", "depth", "state") if colours else ("depth", "state"), scenes=1)
        with contextlib.closing(make_vec_env(config, count, count)) as workers:
            workers.seed(0)
            workers.reset()
            started = time.perf_counter()
            for _ in range(steps):
                workers.step(rng.uniform(-1.0, 1.0, (count, 4)).astype(np.float32))
            seconds = (time.perf_counter() - started) / (steps * count)
        what = f"step of {count} worker{'s' if count > 1 else ''} side by side{'' if colours else ', without colours'}"
        log(f"{what}: {1.0 / seconds:.0f} steps/s")
        alone = seconds if alone is None else alone
        per_core = 1.0 / seconds / min(count, len(os.sched_getaffinity(0)))
        target, note = f"{STEPS_PER_CORE:g} steps/s per core", f"{1.0 / seconds:.0f} steps/s, {per_core:.0f} per core"
        yield Row(what, "1 worker", seconds, alone, target, per_core >= STEPS_PER_CORE, note)


def _learning(quick: bool) -> Iterator[Row]:
    """What choosing actions and learning from them adds to a step, with the hyperparameters of the environment."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.logger import Logger
    from stable_baselines3.common.vec_env import DummyVecEnv

    from agents.network.policy_network import observed_keys, policy_arguments, policy_class
    from agents.ppo.envs import EnvConfig, make_training_env
    from agents.ppo.hyperparameters import read_hyperparameters

    settings = read_hyperparameters(ENV_ID)
    arguments = replace(settings, n_steps=settings.batch_size).ppo_arguments()
    keys = observed_keys(settings.policy, settings.policy_kwargs)
    config = EnvConfig(ENV_ID, keys=keys, wrapper=settings.env_wrapper)
    env = DummyVecEnv([lambda: make_training_env(config, 0, 1)])
    network = policy_arguments(settings.policy_kwargs)
    model = PPO(policy_class(settings.policy), env, policy_kwargs=network, device="cpu", seed=0, **arguments)
    model.set_logger(Logger(None, []))
    env.close()
    log(f"torch {torch.__version__}, {torch.get_num_threads()} threads")
    model.observation_space.seed(0)
    observation = {name: part[None] for name, part in model.observation_space.sample().items()}
    several = {name: np.repeat(part, settings.n_envs, axis=0) for name, part in observation.items()}
    seconds = median_seconds(lambda: model.policy.predict(several), 3 if quick else 30) / settings.n_envs
    yield Row(f"  beside it: choosing actions, {settings.n_envs} at once", "-", seconds, None)
    rng = np.random.default_rng(0)
    for _ in range(settings.batch_size):
        with torch.no_grad():
            actions, values, log_probs = model.policy(model.policy.obs_to_tensor(observation)[0])
        rewards, starts = rng.normal(size=1), np.zeros(1)
        model.rollout_buffer.add(observation, actions.numpy(), rewards, starts, values, log_probs)  # type: ignore[arg-type]
    model.rollout_buffer.compute_returns_and_advantage(torch.zeros(1), np.zeros(1))
    seconds = median_seconds(model.train, 1 if quick else 3) / settings.batch_size
    yield Row(f"  beside it: learning from it, {settings.n_epochs} epochs", "-", seconds, None)
