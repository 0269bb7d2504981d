"""A policy on disk: weights as safetensors, all else as JSON. Nothing is pickled, so files of others are safe to read.

Stable-Baselines3's own zip holds pickles; here the policy is built anew from its description, then takes its weights.
"""

from pathlib import Path
from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy

from agents.network.files import BEST, LAST, NORMALIZE_FILE, POLICY_FILE, WEIGHTS_FILE
from agents.network.policy_network import build_policy
from agents.network.spaces import difference, space_of
from labeling.core.errors import SbmError, UsageError
from labeling.formats.atomic import write_json
from labeling.formats.checked_json import read_json
from labeling.training.weights import read_tensors, save_tensors

FORMAT = 1


def checkpoint_folder(path: Path) -> Path:
    """The checkpoint that is meant by a path: itself, or the best one of a run, or its last.

    Raises:
        UsageError: if there is none.
    """
    for folder in (path, path / BEST, path / LAST):
        if (folder / POLICY_FILE).is_file():
            return folder
    if not path.exists():
        raise UsageError(f"{path}: no such checkpoint; it is the folder of a run of agents.train, or one in it")
    raise UsageError(
        f"{path}: holds no {POLICY_FILE}; a checkpoint is the folder of a run of agents.train, or one in it"
    )


def write_policy(
    folder: Path, policy: ActorCriticPolicy, description: dict[str, Any], normalization: dict[str, Any]
) -> None:
    """Writes a checkpoint into a folder.

    Args:
        folder: an empty one; see ``labeling.formats.atomic.atomic_folder``.
        policy: the weights.
        description: what they are of: ``observation_space``, ``action_space``, ``policy`` and whatever else is known.
        normalization: how rewards were scaled.
    """
    tensors = {name: value.detach().cpu().contiguous() for name, value in _tensors(policy).items()}
    save_tensors(tensors, folder / WEIGHTS_FILE)
    write_json(folder / POLICY_FILE, {"format": FORMAT, **description})
    write_json(folder / NORMALIZE_FILE, normalization)


def read_description(folder: Path) -> dict[str, Any]:
    """What a checkpoint is of.

    Raises:
        SbmError: if it is missing or damaged, or of another format.
    """
    path = folder / POLICY_FILE
    description = read_json(path).mapping()
    if description.get("format") != FORMAT:
        raise SbmError(f"{path}: has format {description.get('format')!r}; this version reads format {FORMAT}")
    policy = description.get("policy")
    if not isinstance(policy, dict) or not isinstance(policy.get("class"), str):
        raise SbmError(f"{path}: is damaged: policy does not name its class")
    if not isinstance(policy.get("kwargs"), dict):
        raise SbmError(f"{path}: is damaged: policy has no kwargs")
    _spaces(description, path)
    return description


def _spaces(description: dict[str, Any], path: Path) -> tuple[spaces.Dict, spaces.Space]:
    """The spaces of observations and actions in a description.

    Raises:
        SbmError: if one is none, or not of the kind that policies have.
    """
    found: list[Any] = []
    for name, kinds in (("observation_space", (spaces.Dict,)), ("action_space", (spaces.Box, spaces.MultiDiscrete))):
        try:
            found.append(space_of(description.get(name)))
        except ValueError as error:
            raise SbmError(f"{path}: is damaged: {name}: {error}") from None
        if not isinstance(found[-1], kinds):
            wanted = " or ".join(kind.__name__ for kind in kinds)
            raise SbmError(f"{path}: is damaged: {name} must be a {wanted}")
    return found[0], found[1]


def check_spaces(
    folder: Path, description: dict[str, Any], observation_space: spaces.Space, action_space: spaces.Space
) -> None:
    """Refuses a checkpoint for other observations or actions than an environment has.

    Raises:
        UsageError: naming the first difference.
    """
    observations, actions = _spaces(description, folder / POLICY_FILE)
    found = difference(observations, observation_space, "observation") or difference(actions, action_space, "action")
    if found:
        trained_on = description.get("env", "another environment")
        raise UsageError(f"{folder}: was trained on {trained_on}: {found}; take the env it was trained on")


def read_policy(folder: Path) -> tuple[ActorCriticPolicy, dict[str, Any]]:
    """A policy on the CPU, and what it is.

    Raises:
        SbmError: if a file is missing or damaged, or its tensors are not those of the policy it says it holds.
    """
    description = read_description(folder)
    about = description["policy"]
    try:
        policy = build_policy(
            *_spaces(description, folder), about["class"], about["kwargs"], about.get("use_sde") is True
        )
    except UsageError as error:
        raise SbmError(f"{folder / POLICY_FILE}: {error}") from None
    load_weights(policy, folder)
    policy.set_training_mode(False)
    return policy, description


def load_weights(policy: ActorCriticPolicy, folder: Path) -> None:
    """Puts the weights of a checkpoint into a policy.

    Raises:
        SbmError: if the file is missing or damaged, or its tensors do not fit.
    """
    described = f"the policy that {POLICY_FILE} describes"
    tensors = read_tensors(folder / WEIGHTS_FILE, _tensors(policy), described, SbmError)
    policy.load_state_dict(tensors, strict=False)


def _tensors(policy: ActorCriticPolicy) -> dict[str, torch.Tensor]:
    """Parameters and buffers, each once: the features extractor that actor and critic share has several names."""
    return {**dict(policy.named_parameters()), **dict(policy.named_buffers())}
