"""Where training stands: all that it takes to go on, beside the policy itself."""

import json
import pickle
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from agents.network.checkpoint import load_weights, read_description
from agents.network.files import NORMALIZE_FILE, STATE_FILE
from labeling.core.errors import EpisodeFormatError, SbmError
from labeling.formats.checked_json import read_json


@dataclass
class Progress:
    """How far training has come, and how it went."""

    steps: int = 0
    best: float | None = None
    """Highest validation return so far."""
    best_steps: int = 0
    rollouts: list[dict[str, float]] = field(default_factory=list)
    """Mean figures of the episodes that ended in each rollout."""
    validations: list[dict[str, float]] = field(default_factory=list)

    @property
    def is_validated(self) -> bool:
        """Whether the latest step has been: the last validation may have been given up."""
        return bool(self.validations) and self.validations[-1]["at"] == self.steps


def normalization_of(env: VecNormalize) -> dict[str, Any]:
    """How rewards are scaled, as JSON: divided by the standard deviation of the discounted return."""
    statistics = env.ret_rms
    return {
        "norm_obs": False,
        "norm_reward": bool(env.norm_reward),
        "gamma": float(env.gamma),
        "epsilon": float(env.epsilon),
        "clip_reward": float(env.clip_reward),
        "return_mean": float(statistics.mean),
        "return_variance": float(statistics.var),
        "return_count": float(statistics.count),
    }


def write_training_state(path: Path, model: PPO, progress: Progress) -> None:
    """Writes what it takes to go on from here. Call between an update and the next rollout."""
    name, keys, position, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002, batches are drawn with it
    content = {
        "optimizer": model.policy.optimizer.state_dict(),
        "updates": model._n_updates,
        "progress": json.dumps(asdict(progress)),
        "torch_random": torch.get_rng_state(),
        "cuda_random": torch.cuda.get_rng_state_all() if model.device.type == "cuda" else [],
        "numpy_random": [str(name), [int(key) for key in keys], int(position), int(has_gauss), float(cached)],
    }
    torch.save(content, path)


def restore_training(model: PPO, env: VecNormalize, folder: Path) -> Progress:
    """Puts a model back to where a checkpoint was written.

    Args:
        model: of the same settings.
        env: its environments.
        folder: the checkpoint.

    Raises:
        SbmError: if a file is missing or damaged, or of another model.
    """
    read_description(folder)
    load_weights(model.policy, folder)
    _restore_normalization(env, folder / NORMALIZE_FILE)
    path = folder / STATE_FILE
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        progress = Progress(**json.loads(content["progress"]))
        model.policy.optimizer.load_state_dict(content["optimizer"])
        _check_optimizer(model.policy.optimizer)
        name, keys, position, has_gauss, cached = content["numpy_random"]
        np.random.set_state((name, np.array(keys, np.uint32), position, has_gauss, cached))  # noqa: NPY002
        torch.set_rng_state(content["torch_random"])
        if model.device.type == "cuda" and content["cuda_random"]:
            torch.cuda.set_rng_state_all(content["cuda_random"])
        model._n_updates = int(content["updates"])
    except FileNotFoundError:
        raise SbmError(f"{path}: no such file; a run goes on from the folder that has one") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise SbmError(f"{path}: is damaged ({type(error).__name__}); start anew with another --out") from None
    model.num_timesteps = progress.steps
    return progress


def _check_optimizer(optimizer: torch.optim.Optimizer) -> None:
    """Raises ValueError where the optimizer's memory of a tensor has another shape than the tensor."""
    for parameter, state in optimizer.state.items():
        for name in ("exp_avg", "exp_avg_sq"):
            if state[name].shape != parameter.shape:
                raise ValueError(f"{name} has shape {tuple(state[name].shape)}, not {tuple(parameter.shape)}")


def _restore_normalization(env: VecNormalize, path: Path) -> None:
    try:
        content = read_json(path)
        mean = content.number("return_mean")
        variance, count = content.number("return_variance", above=0.0), content.number("return_count", above=0.0)
    except EpisodeFormatError as error:
        raise SbmError(f"{error}; start anew with another --out") from None
    env.ret_rms.mean, env.ret_rms.var, env.ret_rms.count = np.float64(mean), np.float64(variance), count
