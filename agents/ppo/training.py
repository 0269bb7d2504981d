"""A training run: a folder that holds the best policy so far, and all it takes to go on after a kill."""

import contextlib
import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from agents.ppo.board import make_logger
from agents.ppo.callbacks import RunCallback
from agents.ppo.imitation import ROUNDS, Demonstration, imitate, joined
from agents.ppo.network.checkpoint import write_policy
from agents.ppo.network.files import BEST, BOARD_FOLDER, HISTORY_FILE, LAST, STATE_FILE
from agents.ppo.network.policy_network import build_policy, pictures, policy_arguments, policy_class
from agents.ppo.network.spaces import describe
from agents.ppo.run_config import TrainConfig
from agents.ppo.settings import RunSettings, claim, settle
from agents.ppo.state import Progress, normalization_of, restore, write_state
from agents.ppo.teachers import Teachers
from agents.ppo.validation import validate
from agents.ppo.workers import make_env, make_workers
from labeling.core.errors import SbmError, UsageError
from labeling.detectors.registry import choose_device
from labeling.io.formats.atomic import atomic_folder, write_json
from labeling.runtime.interrupts import StopRequest, graceful_interrupt
from labeling.runtime.provenance import simulation_provenance


def train(config: TrainConfig, say: Callable[[str], None], bar: Callable[..., Any]) -> Progress:
    """Trains a policy; goes on where a stopped run was.

    Args:
        config: what to train.
        say: where progress is told.
        bar: makes a progress bar (``tqdm``).

    Returns:
        How far training has come, and how it went.

    Raises:
        SbmError: if a setting makes no sense, the folder holds another run, or a worker has died.
        KeyboardInterrupt: if stopped by Ctrl-C, after everything has been saved.
    """
    settings = settle(config)
    device = choose_device(None if config.device == "auto" else config.device)
    with contextlib.ExitStack() as stack:
        validation_env = make_env(replace(settings.env, reward="both"), "val")
        stack.callback(validation_env.close)
        _check_network(settings, validation_env)
        claim(settings)
        say(f"run: {settings.folder} (curves: tensorboard --logdir {settings.folder / BOARD_FOLDER})")
        request = stack.enter_context(graceful_interrupt())
        try:
            return _train(settings, device, validation_env, request, say, bar, stack)
        except (EOFError, ConnectionError) as error:
            raise SbmError(
                f"a worker has died ({type(error).__name__}), see above why; "
                f"--resume {settings.folder} goes on, --envs with fewer workers needs less memory"
            ) from None


def _train(
    settings: RunSettings,
    device: str,
    validation_env: gym.Env,
    request: StopRequest,
    say: Callable[[str], None],
    bar: Callable[..., Any],
    stack: contextlib.ExitStack,
) -> Progress:
    hyperparameters, folder = settings.hyperparameters, settings.folder
    workers = make_workers(settings.env, hyperparameters.n_envs)
    stack.callback(_close, workers)
    env = VecNormalize(workers, gamma=hyperparameters.gamma, **hyperparameters.normalize)
    model = PPO(
        policy_class(hyperparameters.policy),
        env,
        policy_kwargs=policy_arguments(hyperparameters.policy_kwargs),
        device=device,
        seed=settings.seed,
        **hyperparameters.ppo_arguments(),
    )
    progress = Progress()
    if (folder / LAST).is_dir():
        progress = restore(model, env, folder / LAST)
        say(f"going on from step {progress.steps}")
    elif settings.imitate_episodes:
        _warm_start(settings, model, env, request, say, bar)
    if progress.steps >= hyperparameters.n_timesteps:
        say(f"finished at step {progress.steps} already; --steps with more goes on")
        return progress
    # Environments cannot be put back into the middle of an episode: they start new ones, other than those before.
    env.seed(int(np.random.SeedSequence([settings.seed, progress.steps]).generate_state(1)[0] % 2**31))
    model.set_logger(make_logger(folder / BOARD_FOLDER, progress.steps, say))
    origin = simulation_provenance()

    def save(better: bool) -> None:
        description = _description(settings, validation_env, progress) | origin
        for name in (BEST, LAST) if better else (LAST,):
            with atomic_folder(folder / name) as temporary:
                write_policy(temporary, model.policy, description, normalization_of(env))
                if name == LAST:
                    write_state(temporary / STATE_FILE, model, progress)
        write_json(folder / HISTORY_FILE, {"rollouts": progress.rollouts, "validations": progress.validations})

    callback = RunCallback(
        progress,
        settings.eval_every,
        lambda: validate(model.policy, validation_env, settings.eval_episodes, lambda: request.stop),
        save,
        request,
        say,
        bar,
    )
    left = hyperparameters.n_timesteps - progress.steps
    model.learn(left, callback=callback, reset_num_timesteps=False)
    model.logger.close()
    if callback.stopped:
        say(f"stopped at step {progress.steps}; python -m agents.train --resume {folder} goes on")
        raise KeyboardInterrupt
    say(f"policy: {folder / BEST} (return {progress.best:.2f} on validation scenes, at step {progress.best_steps})")
    return progress


def _warm_start(
    settings: RunSettings,
    model: PPO,
    env: VecNormalize,
    request: StopRequest,
    say: Callable[[str], None],
    bar: Callable[..., Any],
) -> None:
    """Lets the network begin with what a hand-written policy does.

    Raises:
        SbmError: if there is no such policy, or a process has died.
        KeyboardInterrupt: if someone wants to stop; the run then begins anew.
    """
    teacher, hyperparameters = settings.imitate, settings.hyperparameters
    keys = ("state", *pictures(hyperparameters.policy_kwargs))
    shown: list[Demonstration] = []
    with (
        contextlib.closing(Teachers(settings.env, teacher, hyperparameters.n_envs)) as teachers,
        tempfile.TemporaryDirectory() as folder,
    ):
        progress = bar(total=settings.imitate_episodes, desc=f"{teacher} shows how")
        for turn, numbers in enumerate(np.array_split(np.arange(settings.imitate_episodes), ROUNDS)):
            if len(numbers) == 0:
                continue
            student = None
            if shown:
                student = Path(folder) / str(turn)
                student.mkdir()
                write_policy(student, model.policy, _network_description(settings, env), normalization_of(env))
            found = {}
            for number, part in request.until_stopped(teachers.show(numbers.tolist(), settings.seed, keys, student)):
                found[number] = part
                progress.update(1)
            newest = [found[number] for number in sorted(found)]
            shown += newest
            off = imitate(model, env, joined(shown), settings.seed)
            earned = float(np.mean([rewards.sum() for part in newest for rewards in part.rewards]))
            who = teacher if student is None else "the network"
            say(f"{who} earned {earned:.2f} in training scenes; its actions differ by {off:.2f} (root mean square)")
        progress.close()


def _network_description(settings: RunSettings, env: gym.Env | VecEnv) -> dict[str, Any]:
    """What it takes to build the network anew."""
    return {
        "observation_space": describe(env.observation_space),
        "action_space": describe(env.action_space),
        "policy": {
            "class": settings.hyperparameters.policy,
            "kwargs": settings.hyperparameters.policy_kwargs,
            "use_sde": settings.hyperparameters.use_sde,
        },
    }


def _check_network(settings: RunSettings, env: gym.Env) -> None:
    """Refuses an environment or a network that do not go together, before any worker starts."""
    observation_space, action_space = env.observation_space, env.action_space
    if not isinstance(observation_space, spaces.Dict) or not isinstance(action_space, spaces.Box):
        raise UsageError(f"env {settings.env.env!r}: observations must be a Dict and actions a Box")
    hyperparameters = settings.hyperparameters
    build_policy(observation_space, action_space, hyperparameters.policy, hyperparameters.policy_kwargs)


def _description(settings: RunSettings, env: gym.Env, progress: Progress) -> dict[str, Any]:
    """What stands in a checkpoint beside its tensors."""
    hyperparameters = settings.hyperparameters
    return {
        "env": settings.env.env,
        **_network_description(settings, env),
        "hyperparameters": asdict(hyperparameters),
        "detector": settings.env.detector,
        "reward": settings.env.reward,
        "seed": settings.seed,
        "imitate": settings.imitate,
        "imitate_episodes": settings.imitate_episodes,
        "steps": progress.steps,
        "validation": {"episodes": settings.eval_episodes, "figures": (progress.validations or [None])[-1]},
    }


def _close(workers: VecEnv) -> None:
    with contextlib.suppress(EOFError, ConnectionError):
        workers.close()
