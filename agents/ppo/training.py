"""Training with PPO: a folder that holds the best policy so far, and all it takes to go on after a kill."""

import contextlib
import math
import os
import shlex
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from agents.evaluation.run import evaluate_policies
from agents.network.checkpoint import write_policy
from agents.network.files import BEST, FIRST, HISTORY_FILE, LAST, STATE_FILE, TENSORBOARD_FOLDER
from agents.network.policy_network import build_policy, policy_arguments, policy_class
from agents.network.spaces import describe
from agents.ppo.baselines import kept_baselines, play_baselines
from agents.ppo.callback import TrainingCallback
from agents.ppo.config import PpoConfig
from agents.ppo.envs import EnvConfig, make_env, make_vec_env, validation_scenes
from agents.ppo.hyperparameters import Hyperparameters
from agents.ppo.ray_vec_env import ray_vec_env
from agents.ppo.report import Pace, commands, comparison, plan, table
from agents.ppo.run_settings import RunSettings, claim_run, resolve_settings
from agents.ppo.training_state import Progress, normalization_of, restore_training, write_training_state
from agents.ppo.validation import MostLikelyAction, validate
from agents.rollouts.environments import same_furniture
from labeling.cluster.ray_connection import check_reachable
from labeling.core.errors import SbmError, UsageError
from labeling.detectors.registry import choose_device
from labeling.formats.atomic import atomic_folder, finish_replacing, write_json
from labeling.runtime.interrupts import graceful_interrupt
from labeling.runtime.process_pool import WorkerDiedError
from labeling.runtime.provenance import simulation_provenance
from labeling.runtime.threads import num_threads, one_network_thread
from labeling.training.curves import tensorboard_writer
from sbm_gym.env.view_detectors import digest_of_detector

MAX_WEIGHT = 1e9
"""Networks with larger weights, or with some that are no numbers, have diverged."""


def train_ppo(config: PpoConfig, say: Callable[[str], None], progress_bar: Callable[..., Any]) -> Progress:
    """Trains a policy; goes on where a stopped run was.

    Args:
        config: what to train.
        say: where progress is told.
        progress_bar: makes a progress bar (``tqdm``).

    Returns:
        How far training has come, and how it went.

    Raises:
        SbmError: if a setting makes no sense, the folder holds another run, or a worker has died.
        KeyboardInterrupt: if stopped by Ctrl-C, after everything has been saved; SystemExit by other signals.

    Example:
        >>> from tqdm import tqdm
        >>> from agents import PpoConfig, train_ppo
        >>> progress = train_ppo(PpoConfig(out=Path("run"), steps=8000), print, tqdm)  # doctest: +SKIP, takes minutes
    """
    settings = resolve_settings(config, say)
    most = num_threads() if config.processes is None or not config.where.is_local else config.processes
    processes = min(most, settings.hyperparameters.n_envs)
    progress, scenes = _train(settings, config, processes, say, progress_bar)
    say(
        f"policy: {settings.folder / BEST} (return {progress.best:.2f} on validation scenes, at step "
        f"{progress.best_steps})"
    )
    if scenes and config.compare_episodes and (settings.folder / FIRST).is_dir():
        content = evaluate_policies(comparison(settings, config.compare_episodes, processes), show=lambda _: None)
        say(table(content, progress))
    say(commands(settings))
    return progress


def _train(
    settings: RunSettings,
    config: PpoConfig,
    processes: int,
    say: Callable[[str], None],
    progress_bar: Callable[..., Any],
) -> tuple[Progress, tuple[str, ...]]:
    """Trains to the end; returns how it went, and the scenes it was validated in.

    Raises:
        SbmError: see ``train_ppo``.
        KeyboardInterrupt: likewise.
    """
    folder, seed, hyperparameters = settings.folder, settings.options.seed, settings.hyperparameters
    device = choose_device(None if config.device == "auto" else config.device)
    with contextlib.ExitStack() as stack:
        stack.enter_context(one_network_thread())
        validation_env = make_env(settings.validation_config)
        stack.callback(validation_env.close)
        scenes = validation_scenes(validation_env, settings.env_config)
        _check_network(settings, validation_env)
        common = config.where.files_named(*_files_of(settings.env_config))
        if not config.where.is_local:
            check_reachable(config.where.cluster)
        claim_run(settings, _digests(settings, validation_env))

        request = stack.enter_context(graceful_interrupt())
        stack.enter_context(_dead_workers_explained(folder))
        if config.where.is_local:
            workers = make_vec_env(settings.env_config, hyperparameters.n_envs, processes)
            stack.callback(_close, workers)
        else:
            same = same_furniture(validation_env)
            rollouts = ray_vec_env(
                settings.env_config, hyperparameters.n_envs, config.processes, config.where, common, same
            )
            workers = stack.enter_context(rollouts)
        env = VecNormalize(workers, gamma=hyperparameters.gamma, **hyperparameters.normalize)
        model = PPO(
            policy_class(hyperparameters.policy),
            env,
            policy_kwargs=policy_arguments(hyperparameters.policy_kwargs),
            device=device,
            seed=seed,
            **hyperparameters.ppo_arguments(),
        )
        progress = Progress()
        finish_replacing(folder / LAST)
        if (folder / LAST).is_dir():
            progress = restore_training(model, env, folder / LAST)
            say(f"going on from step {progress.steps}")
            _write_history(folder, progress, kept_baselines(folder))  # a kill may have come between the two
        if progress.steps >= hyperparameters.n_timesteps and progress.is_validated:
            say(f"finished at step {progress.steps} already; --steps with more goes on")
            return progress, scenes
        say(plan(settings, progress.steps, len(scenes), config.compare_episodes))
        views = validation_env.spec.max_episode_steps if validation_env.spec else None
        if views and hyperparameters.n_steps % views:
            say(
                f"note: n_steps {hyperparameters.n_steps} is no multiple of the {views} steps of an episode: a run "
                "that is stopped begins anew the episodes that were under way, and ends otherwise than one that is not"
            )
        baselines = kept_baselines(folder)
        if baselines is None and scenes:
            episodes = settings.options.eval_episodes
            baselines = play_baselines(
                settings.validation_config, episodes, scenes, processes, progress_bar, request.is_set
            )
            if baselines is None:
                say(f"stopped before the first step; {_resume(folder)} goes on")
                request.leave()
        baselines = baselines or {}
        # Where rollouts hold whole episodes, a run that goes on plays the very ones that it would have played.
        env.seed(int(np.random.SeedSequence([seed, 0]).generate_state(1)[0] % 2**31))
        env.env_method("begin_at", progress.steps // (hyperparameters.n_envs * (views or 1)))
        curves = stack.enter_context(tensorboard_writer(folder / TENSORBOARD_FOLDER, progress.steps, say))
        model.set_logger(Logger(None, [] if curves is None else [_Curves(curves)]))
        levels = {} if curves is None else {name: folder / TENSORBOARD_FOLDER / name for name in baselines}
        lines = {
            name: stack.enter_context(tensorboard_writer(path, progress.steps, say)) for name, path in levels.items()
        }
        origin = simulation_provenance()

        def save(is_best: bool) -> None:
            description = _description(settings, validation_env, progress) | origin
            untrained = progress.steps == 0
            for name in (*(FIRST,) * untrained, *(BEST,) * is_best, LAST):
                with atomic_folder(folder / name) as temporary:
                    write_policy(temporary, model.policy, description, normalization_of(env))
                    if name == LAST:
                        write_training_state(temporary / STATE_FILE, model, progress)
            _write_history(folder, progress, baselines)
            for name, line in lines.items():
                line.add_scalar("validation/return", baselines[name]["return"], progress.steps)

        def validated() -> dict[str, float] | None:
            policy = MostLikelyAction(model.policy)
            return validate(policy, validation_env, settings.options.eval_episodes, request.is_set, scenes)

        eval_every = settings.options.eval_every
        pace = Pace(hyperparameters.n_timesteps, eval_every)
        callback = TrainingCallback(progress, eval_every, validated, save, request, say, progress_bar, pace, baselines)
        try:
            model.learn(hyperparameters.n_timesteps - progress.steps, callback=callback, reset_num_timesteps=False)
        except ValueError:
            if not _has_diverged(model.policy):
                raise
            raise SbmError(
                f"training has diverged after step {progress.steps}: weights are too large for any use; start anew "
                "with a smaller learning_rate"
            ) from None
    if callback.stopped or not progress.is_validated:
        say(f"stopped at step {progress.steps}; {_resume(folder)} goes on")
        request.leave()
    return progress, scenes


def _write_history(folder: Path, progress: Progress, baselines: Any) -> None:
    history = {"rollouts": progress.rollouts, "validations": progress.validations, "baselines": baselines}
    write_json(folder / HISTORY_FILE, history)


def _digests(settings: RunSettings, env: gym.Env) -> dict[str, str]:
    """What stands behind the name of the detector, where the environment has one and it can change."""
    if not env.has_wrapper_attr("categories"):
        return {}
    digest = digest_of_detector(settings.options.detector)
    return {"detector_digest": digest} if digest else {}


def _has_diverged(network: torch.nn.Module) -> bool:
    return not all(bool((value.abs() < MAX_WEIGHT).all()) for value in network.state_dict().values())


def _check_rollout_fits(hyperparameters: Hyperparameters, observation_space: spaces.Dict) -> None:
    """Refuses rollouts whose observations no memory would hold.

    Raises:
        UsageError: telling how much they take.
    """
    steps = hyperparameters.n_envs * hyperparameters.n_steps
    taken = steps * sum(
        math.prod(space.shape or (1,)) * np.dtype(space.dtype or np.float32).itemsize
        for space in observation_space.values()
    )
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if taken > there:
        raise UsageError(
            f"observations of a rollout of n_envs * n_steps = {steps:,} steps take {taken / 1e9:,.0f} GB, more than "
            f"the {there / 1e9:,.0f} GB of this machine; give a smaller n_steps"
        )


def _files_of(config: EnvConfig) -> list[str]:
    """Names that may lead to files that environments read."""
    return [config.detector, *([] if config.atlas is None else [config.atlas])]


class _Curves(TensorBoardOutputFormat):
    """Draws from a step on; the constructor of Stable-Baselines3 would keep what lies after it."""

    def __init__(self, writer: Any) -> None:
        self.writer, self._is_closed = writer, False


def _check_network(settings: RunSettings, env: gym.Env) -> None:
    """Refuses an environment or a network that do not go together, before any worker starts."""
    observation_space, action_space = env.observation_space, env.action_space
    kinds = (spaces.Box, spaces.MultiDiscrete)
    if not isinstance(observation_space, spaces.Dict) or not isinstance(action_space, kinds):
        raise UsageError(
            f"env {settings.options.env!r}: observations must be a Dict and actions a Box or MultiDiscrete"
        )
    hyperparameters = settings.hyperparameters
    _check_rollout_fits(hyperparameters, observation_space)
    build_policy(observation_space, action_space, hyperparameters.policy, hyperparameters.policy_kwargs)


def _description(settings: RunSettings, env: gym.Env, progress: Progress) -> dict[str, Any]:
    """What a checkpoint says beside its tensors: how to build the network anew, and where it comes from."""
    options, hyperparameters = settings.options, settings.hyperparameters
    return {
        "env": options.env,
        "observation_space": describe(env.observation_space),
        "action_space": describe(env.action_space),
        "policy": {
            "class": hyperparameters.policy,
            "kwargs": hyperparameters.policy_kwargs,
            "use_sde": hyperparameters.use_sde,
        },
        "hyperparameters": asdict(hyperparameters),
        **{name: getattr(options, name) for name in ("detector", "reward", "seed", "scenes", "validation_scenes")},
        "steps": progress.steps,
        "validation": {"episodes": options.eval_episodes, "figures": (progress.validations or [None])[-1]},
    }


@contextlib.contextmanager
def _dead_workers_explained(folder: Path) -> Iterator[None]:
    """Says what to do where a worker's pipe has closed, or a cluster has lost its process again and again."""
    try:
        yield
    except WorkerDiedError as error:
        raise SbmError(f"{error}; {_resume(folder)} goes on from the last checkpoint") from None
    except (EOFError, ConnectionError) as error:
        raise SbmError(
            f"a worker has died ({type(error).__name__}), see above why; "
            f"{_resume(folder)} goes on, --envs with fewer workers needs less memory"
        ) from None


def _resume(folder: Path) -> str:
    """The command that goes on with a run."""
    return f"python -m agents.train --resume {shlex.quote(str(folder))}"


def _close(workers: VecEnv) -> None:
    with contextlib.suppress(EOFError, ConnectionError):
        workers.close()
