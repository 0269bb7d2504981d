"""Hyperparameters: the shape rl-zoo users know, without evaluating anything."""

import tomllib
from pathlib import Path

import pytest

from agents.network.policy_network import policy_arguments
from agents.ppo.hyperparameters import SHIPPED_FILE, Hyperparameters, read_hyperparameters, schedule
from labeling.core.errors import UsageError
from sbm_gym.registration import ENV_IDS, MAX_EPISODE_STEPS

ROOT = Path(__file__).resolve().parents[3]


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "ppo.yaml"
    path.write_text("toy/Echo-v0:\n" + "".join(f"  {line}\n" for line in text.splitlines()))
    return path


@pytest.mark.parametrize("env_id", ENV_IDS)
def test_every_environment_has_some_that_fit_it(env_id):
    found = read_hyperparameters(env_id)
    assert found.n_steps % MAX_EPISODE_STEPS == 0
    assert found.n_envs * found.n_steps % found.batch_size == 0
    policy_arguments(found.policy_kwargs)


def test_they_are_installed_with_the_package():
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    globs = content["tool"]["setuptools"]["package-data"]["agents"]
    shipped = {path for pattern in globs for path in (ROOT / "agents").glob(pattern)}
    assert SHIPPED_FILE in shipped


def test_numbers_and_schedules_are_written_as_in_rl_zoo(tmp_path):
    text = """n_timesteps: !!float 1e5
learning_rate: lin_3e-4
ent_coef: 1e-3
clip_range: lin_0.2
normalize: {norm_obs: False, norm_reward: True}
policy_kwargs: {log_std_init: -2, net_arch: {pi: [64, 32], vf: [64]}, activation_fn: ReLU}
target_kl: 0.03
use_sde: True
sde_sample_freq: 25"""
    found = read_hyperparameters("toy/Echo-v0", written(tmp_path, text))
    assert (found.n_timesteps, found.ent_coef, found.target_kl) == (100_000, 0.001, 0.03)
    assert found.normalize == {"norm_obs": False, "norm_reward": True}
    assert found.policy_kwargs == {
        "log_std_init": -2,
        "net_arch": {"pi": [64, 32], "vf": [64]},
        "activation_fn": "ReLU",
    }
    arguments = found.ppo_arguments()
    assert [arguments["learning_rate"](left) for left in (1.0, 0.5, 0.0)] == pytest.approx([3e-4, 1.5e-4, 0.0])
    assert arguments["clip_range"](0.5) == pytest.approx(0.1)
    assert arguments["n_epochs"] == Hyperparameters(1).n_epochs
    assert (arguments["use_sde"], arguments["sde_sample_freq"]) == (True, 25)


def test_mappings_and_truth_values_of_yaml_are_read_too(tmp_path):
    found = read_hyperparameters(
        "toy/Echo-v0", written(tmp_path, "n_timesteps: 10\nnormalize: false\npolicy_kwargs:\n  net_arch: [8]")
    )
    assert found.normalize["norm_reward"] is False
    assert found.policy_kwargs == {"net_arch": [8]}
    assert schedule(0.5) == 0.5


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("n_timesteps: 10\nlearning_rat: 1", "unknown hyperparameter 'learning_rat'; known: n_timesteps, n_envs"),
        ("gamma: 1", "n_timesteps is missing"),
        ("n_timesteps: -5", "n_timesteps must be a whole number above 0, not -5"),
        ("n_timesteps: 0", "n_timesteps must be a whole number above 0"),
        ("n_timesteps: 10\nn_steps: 2.5", "n_steps must be a whole number"),
        ("n_timesteps: 10\nn_epochs: 1000000000.0", "n_epochs must be at most 1000, not 1000000000: it would not end"),
        ("n_timesteps: 10\ngamma: high", "gamma must be a number from 0, not 'high'"),
        ("n_timesteps: 10\ngamma: lin_0.9", "gamma must be a number"),
        ("n_timesteps: 10\nent_coef: true", "ent_coef must be a number"),
        ("n_timesteps: 10\nlearning_rate: lin_x", "lin_0.0003"),
        ("n_timesteps: 10\nlearning_rate: .nan", "learning_rate must be a number"),
        ("n_timesteps: 10\nuse_sde: 1", "use_sde must be true or false, not 1"),
        ("n_timesteps: 10\nsde_sample_freq: -2", "sde_sample_freq must be a whole number above 0, not -2"),
        ("n_timesteps: 10\nenv_wrapper: os.system", "moves_and_looks_without_history, not 'os.system'"),
        ("n_timesteps: 10\nnormalize: true\npolicy_kwargs: 3", "policy_kwargs must be a mapping"),
        (
            "n_timesteps: 10\npolicy_kwargs: dict(net_arch=[8])",
            "policy_kwargs must be a mapping, not 'dict(",
        ),
        ("n_timesteps: 10\nnormalize: {norm_obs: true}", "observations are scaled already"),
        ("n_timesteps: 10\nnormalize: {norm_reward: 'yes'}", "norm_reward must be true or false"),
        ("n_timesteps: 10\nnormalize: {clip_reward: abc}", "clip_reward a number"),
        ("n_timesteps: 10\nnormalize: {clip_reward: 0}", "clip_reward must be above 0"),
        ("n_timesteps: 10\ngamma: 7", "gamma must be at most 1, not 7"),
        ("n_timesteps: 10\ngae_lambda: 99", "gae_lambda must be at most 1"),
        ("n_timesteps: !!python/object/apply:os.getcwd []", "is not YAML"),
        ("n_timesteps: [", "is not YAML"),
    ],
)
def test_nonsense_is_one_line_that_names_it(tmp_path, text, says):
    with pytest.raises(UsageError) as caught:
        read_hyperparameters("toy/Echo-v0", written(tmp_path, text))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_environments_without_an_entry_get_the_default_and_are_told(tmp_path):
    said: list[str] = []
    assert read_hyperparameters("x/Moon-v0", say=said.append) == read_hyperparameters("sbm_gym/Indoor-v0")
    assert len(said) == 1
    assert said[0].endswith("ppo.yaml has none for 'x/Moon-v0', so those of its entry 'default' are taken")
    read_hyperparameters("sbm_gym/Indoor-v0", say=said.append)
    assert len(said) == 1
    path = tmp_path / "own.yaml"
    path.write_text("default: {n_timesteps: 7}\n")
    assert read_hyperparameters("x/Moon-v0", path).n_timesteps == 7
    path.write_text("default: &default {gamma: 0.5}\ntoy/Echo-v0: {<<: *default, n_timesteps: 7}\n")
    with pytest.raises(UsageError, match=r"has no entry 'x/Moon-v0', only default, toy/Echo-v0"):
        read_hyperparameters("x/Moon-v0", path)


def test_missing_files_and_entries_name_what_there_is(tmp_path):
    with pytest.raises(UsageError, match=r"has no entry 'x/Moon-v0', only toy/Echo-v0"):
        read_hyperparameters("x/Moon-v0", written(tmp_path, "n_timesteps: 1"))
    with pytest.raises(UsageError, match=r"none\.yaml: No such file"):
        read_hyperparameters("x/Moon-v0", tmp_path / "none.yaml")
