"""Checkpoints: what is written is read back, and what is not whole or not for this env is refused in one line."""

import json
import pickle
import shutil
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import load_file, save_file

from agents.network.checkpoint import checkpoint_folder, read_policy, write_policy
from agents.network.files import NORMALIZE_FILE, POLICY_FILE, WEIGHTS_FILE
from agents.network.policy_network import build_policy
from agents.network.spaces import describe, difference, space_of
from agents.policies.ppo import Ppo
from labeling.core.errors import SbmError, UsageError

from ..toy_world import ENV_ID, Echo

KWARGS = {"net_arch": [8], "features_extractor_kwargs": {"features": 8, "picture_features": 4, "channels": [4]}}


@pytest.fixture
def checkpoint(tmp_path) -> Path:
    torch.manual_seed(0)
    env = Echo()
    policy = build_policy(env.observation_space, env.action_space, "MultiInputPolicy", KWARGS)  # type: ignore[arg-type]
    folder = tmp_path / "run" / "best"
    folder.mkdir(parents=True)
    description = {
        "env": ENV_ID,
        "observation_space": describe(env.observation_space),
        "action_space": describe(env.action_space),
        "policy": {"class": "MultiInputPolicy", "kwargs": KWARGS},
    }
    write_policy(folder, policy, description, {"norm_reward": True})
    return folder


def actions(policy: Ppo, seed: int = 0, env_id: str = ENV_ID) -> np.ndarray:
    env = gym.make(env_id)
    observation, info = env.reset(seed=3)
    policy.reset(env, observation, info, np.random.default_rng(seed))
    taken = []
    for _ in range(5):
        taken.append(policy.act(observation, info))
        observation, *_, info = env.step(taken[-1])
        assert env.action_space.contains(taken[-1])
    return np.array(taken)


def test_weights_come_back_as_they_were(checkpoint):
    policy, description = read_policy(checkpoint)
    env = Echo()
    other = build_policy(env.observation_space, env.action_space, "MultiInputPolicy", KWARGS)  # type: ignore[arg-type]
    different = zip(policy.parameters(), other.parameters(), strict=True)
    assert not all(torch.equal(one, another) for one, another in different)
    again = checkpoint.parent / "again"
    again.mkdir()
    write_policy(again, policy, description, {})
    assert (again / WEIGHTS_FILE).read_bytes() == (checkpoint / WEIGHTS_FILE).read_bytes()
    assert description["env"] == ENV_ID


def test_actions_are_the_same_for_the_same_observations(checkpoint):
    one = actions(Ppo(checkpoint), seed=0)
    assert np.array_equal(one, actions(Ppo(checkpoint), seed=1))
    policy = Ppo(checkpoint)
    assert np.array_equal(actions(policy), actions(policy))
    assert one.dtype == np.float32


def test_policies_whose_noise_depends_on_the_state_come_back_too(tmp_path):
    env = Echo()
    policy = build_policy(env.observation_space, env.action_space, "MultiInputPolicy", KWARGS, True)  # type: ignore[arg-type]
    description = {
        "observation_space": describe(env.observation_space),
        "action_space": describe(env.action_space),
        "policy": {"class": "MultiInputPolicy", "kwargs": KWARGS, "use_sde": True},
    }
    write_policy(tmp_path, policy, description, {})
    again, _ = read_policy(tmp_path)
    observation, _ = env.reset(seed=3)
    assert np.array_equal(
        again.predict(observation, deterministic=True)[0], policy.predict(observation, deterministic=True)[0]
    )


def test_a_run_means_its_best_policy(checkpoint):
    assert checkpoint_folder(checkpoint.parent) == checkpoint
    assert np.array_equal(actions(Ppo(checkpoint.parent)), actions(Ppo(checkpoint)))


@pytest.mark.parametrize(("name", "says"), [("nowhere", "no such checkpoint"), ("empty", "holds no policy.json")])
def test_missing_checkpoints_are_named(tmp_path, name, says):
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=says):
        Ppo(tmp_path / name)


def test_another_observation_space_is_refused_in_one_line_that_names_it(checkpoint):
    with pytest.raises(UsageError) as caught:
        actions(Ppo(checkpoint), env_id="toy/Large-v0")
    line = str(caught.value)
    assert "observation 'depth' has shape 16x16x1 in the checkpoint, 24x24x1 in the env" in line
    assert ENV_ID in line
    assert "\n" not in line


def test_another_action_space_is_refused(checkpoint):
    class Narrow(Echo):
        def __init__(self):
            super().__init__()
            self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)

    env = Narrow()
    with pytest.raises(UsageError, match="action has shape 4 in the checkpoint, 2 in the env"):
        Ppo(checkpoint).reset(env, *env.reset(seed=0), np.random.default_rng(0))


def edited(folder: Path, **changes) -> None:
    path = folder / POLICY_FILE
    content = json.loads(path.read_text())
    for name, value in changes.items():
        if value is None:
            del content[name]
        else:
            content[name] = value
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": 2}, "has format 2; this version reads format 1"),
        ({"format": None}, "has format None"),
        ({"observation_space": None}, "observation_space"),
        ({"observation_space": {"type": "Discrete", "n": 4}}, "observation_space: no space is described"),
        ({"observation_space": {"type": "Dict", "spaces": [1]}}, "observation_space"),
        ({"action_space": {"type": "Box", "shape": [-4], "dtype": "float32", "low": -1, "high": 1}}, "shape"),
        ({"action_space": {"type": "Box", "shape": [4], "dtype": "object", "low": -1, "high": 1}}, "action_space"),
        ({"action_space": {"type": "Box", "shape": [4], "dtype": "float32", "low": [1, 2], "high": 1}}, "action_space"),
        ({"policy": "MultiInputPolicy"}, "policy does not name its class"),
        ({"policy": {"class": "os.system", "kwargs": {}}}, "unknown policy 'os.system'"),
        ({"policy": {"class": "MultiInputPolicy"}}, "has no kwargs"),
        ({"policy": {"class": "MultiInputPolicy", "kwargs": {"net_arch": "wide"}}}, "policy_kwargs"),
        ({"policy": {"class": "MultiInputPolicy", "kwargs": {**KWARGS, "net_arch": [9]}}}, "do not fit"),
    ],
)
def test_descriptions_that_make_no_sense_are_refused_in_one_line(checkpoint, changes, says):
    edited(checkpoint, **changes)
    with pytest.raises(SbmError) as caught:
        Ppo(checkpoint)
    assert says in str(caught.value)
    assert POLICY_FILE in str(caught.value) or WEIGHTS_FILE in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"\xff\xfe", b"null"])
def test_damaged_json_is_refused(checkpoint, content):
    (checkpoint / POLICY_FILE).write_bytes(content)
    with pytest.raises(SbmError, match=POLICY_FILE):
        Ppo(checkpoint)


def test_wrong_tensors_are_refused(checkpoint):
    path = checkpoint / WEIGHTS_FILE
    tensors = load_file(path)

    def refused(changed: dict, says: str) -> None:
        save_file(changed, path)
        with pytest.raises(SbmError, match=says):
            Ppo(checkpoint)

    missing = {name: value for name, value in tensors.items() if name != "log_std"}
    refused(missing, "log_std and 0 more do not fit")
    refused({**tensors, "extra": torch.zeros(1)}, "extra and 0 more do not fit")
    refused({**tensors, "log_std": torch.zeros(5)}, "log_std and 0 more do not fit")
    refused({**tensors, "log_std": torch.full((4,), torch.nan)}, "log_std holds NaN or infinity")
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(SbmError, match="is damaged or no safetensors file"):
        Ppo(checkpoint)
    path.write_bytes(pickle.dumps({"log_std": [0]}))
    with pytest.raises(SbmError, match="is damaged or no safetensors file"):
        Ppo(checkpoint)
    path.unlink()
    with pytest.raises(SbmError, match="no such file"):
        Ppo(checkpoint)


def test_nothing_but_weights_and_description_is_needed(checkpoint, tmp_path):
    shutil.copytree(checkpoint, tmp_path / "moved")
    (tmp_path / "moved" / NORMALIZE_FILE).unlink()
    assert np.array_equal(actions(Ppo(tmp_path / "moved")), actions(Ppo(checkpoint)))


SIZES = st.lists(st.integers(1, 4), min_size=1, max_size=3).map(tuple)
BOXES = st.one_of(
    SIZES.map(lambda shape: spaces.Box(0, 255, shape, np.uint8)),
    SIZES.map(lambda shape: spaces.Box(-np.inf, np.inf, shape, np.float32)),
    SIZES.map(
        lambda shape: spaces.Box(
            -np.arange(1, np.prod(shape) + 1, dtype=np.float32).reshape(shape), np.ones(shape, np.float32)
        )
    ),
)
ANY_SPACE = st.one_of(
    BOXES, st.dictionaries(st.sampled_from("abc"), BOXES, min_size=1).map(lambda parts: spaces.Dict({**parts}))
)


@settings(max_examples=40)
@given(ANY_SPACE)
def test_spaces_survive_json(space):
    again = space_of(json.loads(json.dumps(describe(space), allow_nan=False)))
    assert again == space
    assert difference(space, again, "observation") is None


@pytest.mark.parametrize(
    "claim",
    [
        {"type": "Box", "dtype": "float32", "shape": [2**31], "low": 0.0, "high": 1.0},
        {"type": "Box", "dtype": "uint8", "shape": [60_000, 60_000, 3], "low": 0.0, "high": 255.0},
        {"type": "MultiDiscrete", "nvec": [3, 10**9]},
    ],
)
def test_spaces_that_claim_gigabytes_are_refused_before_anything_is_made(claim):
    with pytest.raises(ValueError, match="no space has the"):
        space_of(claim)


@settings(max_examples=40)
@given(ANY_SPACE, ANY_SPACE)
def test_spaces_differ_in_words_exactly_if_they_differ(wanted, given_space):
    same = wanted == given_space
    if isinstance(wanted, spaces.Dict) and isinstance(given_space, spaces.Dict):
        # Parts that the checkpoint knows nothing of do not matter to it.
        same = all(given_space.spaces.get(name) == part for name, part in wanted.spaces.items())
    assert (difference(wanted, given_space, "observation") is None) == same
