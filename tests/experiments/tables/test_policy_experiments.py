"""The experiments about policies run, resume, never look at test scenes, and sum up what the episodes say."""

import json
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from agents import rollout
from agents.evaluation.label_quality import episode_figures
from agents.evaluation.results import read_result
from agents.evaluation.run import Evaluator
from agents.ppo.hyperparameters import SHIPPED_FILE, read_hyperparameters
from experiments.ablations import reward_ablation
from experiments.run import main
from experiments.tables import policy_bound, policy_evaluation
from experiments.tables.trained_policies import training_command

from ..box_env import ENV_ID, SHORT_ENV_ID


def run(name: str, folder: Path, seeds: int = 1) -> int:
    places = [f"--{place}={folder / place}" for place in ("cache", "results", "docs")]
    return main([name, "--scale", "smoke", "--seeds", str(seeds), "--workers", "1", *places])


@pytest.mark.slow
def test_policies_are_compared_and_results_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(policy_evaluation, "WORLDS", {"rooms": ENV_ID})
    monkeypatch.setattr(policy_evaluation, "DETECTOR", "simulated")
    monkeypatch.setattr(policy_evaluation, "POLICIES", ("ring", "random", "spin", "ppo"))
    assert run("policy_evaluation", tmp_path) == 0
    content = json.loads((tmp_path / "results" / "policy_evaluation.json").read_text())
    boxes = content["worlds"]["rooms"]
    assert boxes["settings"]["split"] == "endless"
    assert boxes["settings"]["scenes"] == ["box_3"]
    assert list(boxes["policies"]) == ["ring", "random", "spin"]
    assert all(found["labels"] for found in boxes["policies"].values())
    assert "no trained policy" in boxes["left_out"]["ppo"]
    assert boxes["trained"] == {}
    assert list(boxes["policies"]["ring"]["labels"]) == ["12", "25"]
    (file,) = (tmp_path / "cache" / "policy_evaluation").rglob("random/*.json")
    figures = boxes["policies"]["random"]["figures"]
    for name, value in read_result(file)["figures"].items():
        assert figures[name]["mean"] == pytest.approx(value, abs=1e-4)
    early = boxes["policies"]["random"]["early"]
    assert (early["views"], early["base_views"]) == (12, 25)
    labels = {policy: found["labels"] for policy, found in boxes["policies"].items() if found["labels"]}
    expected = labels["random"]["12"]["right"]["mean"] - labels["ring"]["25"]["right"]["mean"]
    assert early["difference"]["right"]["mean"] == pytest.approx(expected)
    pairs = boxes["pairs"]["random minus ring"]
    for name in ("right", "objects", "ap50"):
        values = [labels[policy]["25"][name]["mean"] for policy in ("random", "ring")]
        if None not in values:
            assert pairs[f"{name}@25"]["mean"] == pytest.approx(values[0] - values[1], abs=1e-4)
    returns = [boxes["policies"][policy]["figures"]["return"]["mean"] for policy in ("random", "ring")]
    assert pairs["return"]["mean"] == pytest.approx(returns[0] - returns[1], abs=1e-4)
    page = (tmp_path / "docs" / "policies-results.md").read_text()
    assert "`ppo` is left out" in page
    monkeypatch.setattr(Evaluator, "run", None)  # a second run has nothing left to do
    assert run("policy_evaluation", tmp_path) == 0
    again = json.loads((tmp_path / "results" / "policy_evaluation.json").read_text())
    assert again["worlds"] == content["worlds"]
    capsys.readouterr()


@pytest.mark.slow
def test_policies_without_a_map_have_a_section_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_evaluation, "WORLDS", {"rooms": ENV_ID})
    monkeypatch.setattr(policy_evaluation, "DETECTOR", "simulated")
    monkeypatch.setattr(policy_evaluation, "UNMAPPED", ("spin", "next_best_view:unmapped", "ppo_unmapped"))
    assert run("policy_evaluation_unmapped", tmp_path) == 0
    content = json.loads((tmp_path / "results" / "policy_evaluation_unmapped.json").read_text())
    assert content["compared_with"] == "spin"
    assert list(content["worlds"]["rooms"]["policies"]) == ["spin", "next_best_view:unmapped"]
    page = (tmp_path / "docs" / "policies-results.md").read_text()
    assert "### Rooms without a map" in page
    assert "`ppo_unmapped` is left out" in page


@pytest.mark.slow
def test_the_homes_of_wide_have_a_record_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(policy_evaluation, "WORLDS", {"rooms": SHORT_ENV_ID})
    monkeypatch.setattr(policy_evaluation, "DETECTOR", "simulated")
    monkeypatch.setattr(policy_evaluation, "WIDE_POLICIES", ("ring", "random"))
    monkeypatch.setattr(policy_evaluation, "WIDE", "test")
    assert run("policy_evaluation_wide", tmp_path) == 0
    content = json.loads((tmp_path / "results" / "policy_evaluation_wide.json").read_text())
    boxes = content["worlds"]["rooms"]
    assert boxes["settings"]["split"] == "test"
    returns = [boxes["policies"][policy]["figures"]["return"]["mean"] for policy in ("random", "ring")]
    assert boxes["pairs"]["random minus ring"]["return"]["mean"] == pytest.approx(returns[0] - returns[1], abs=1e-4)
    assert "## The homes of `wide`" in (tmp_path / "docs" / "policies-results.md").read_text()


@pytest.mark.slow
def test_parts_of_the_reward_are_compared_from_the_same_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reward_ablation, "WORLDS", {"boxes": SHORT_ENV_ID})
    assert run("reward_ablation", tmp_path, seeds=2) == 0
    content = json.loads((tmp_path / "results" / "reward_ablation.json").read_text())
    assert content["worlds"]["boxes"]["settings"]["split"] == "endless"
    policies = content["worlds"]["boxes"]["policies"]
    assert list(policies) == list(reward_ablation.POLICIES)
    for policy, found in policies.items():
        files = sorted((tmp_path / "cache" / "reward_ablation").rglob(f"{policy.replace(':', '-')}/*.json"))
        played = [read_result(file)["figures"] for file in files]
        for name, figure in found["figures"].items():
            assert figure["per_seed"] == pytest.approx([one[name] for one in played], abs=1e-4)
    assert "parts of the reward" in (tmp_path / "docs" / "policies-results.md").read_text()
    monkeypatch.setattr(Evaluator, "run", None)  # a second run has nothing left to do
    assert run("reward_ablation", tmp_path, seeds=2) == 0
    assert json.loads((tmp_path / "results" / "reward_ablation.json").read_text())["worlds"] == content["worlds"]
    capsys.readouterr()


def test_no_policy_is_compared_on_test_scenes() -> None:
    assert policy_evaluation.SPLIT == "endless"


def test_commands_name_what_differs_from_the_defaults() -> None:
    description = {
        "env": "sbm_gym/Outdoor-v0",
        "seed": 0,
        "detector": "compact",
        "reward": "both",
        "imitate_episodes": 0,
        "hyperparameters": {"n_timesteps": 1000, "n_envs": 2},
        "validation": {"episodes": 7},
        "git_commit": "abc",
    }
    command = "python -m agents.train --env sbm_gym/Outdoor-v0 --steps 1000 --seed 0 --envs 2 --detector compact"
    assert training_command(description) == f"{command} --eval-episodes 7"
    assert "--eval-every 30" in training_command({**description, "eval_every": 30})


@pytest.mark.nightly
def test_the_best_of_many_ways_is_that_of_the_episodes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(policy_bound, "WORLDS", {policy_bound.WORLD: ENV_ID})
    monkeypatch.setattr(policy_bound, "DETECTOR", "simulated")
    monkeypatch.setattr(policy_bound, "POLICIES", ("ring", "random"))
    assert run("policy_bound", tmp_path) == 0
    content = json.loads((tmp_path / "results" / "policy_bound.json").read_text())
    assert content["starts"] == ["box_3"]
    plays = sorted((tmp_path / "cache" / "policy_bound").rglob("random/*.json"))
    assert len(plays) == content["draws"] == 2
    for views in ("12", "25"):
        figures = (episode_figures(read_result(file)["label_quality"])[views] for file in plays)
        right = [float(one["right"] or 0.0) for one in figures]
        found = content["policies"]["random"][views]
        assert (found["mean"], found["best"]) == (pytest.approx(np.mean(right)), max(right))
    assert "| `random` |" in (tmp_path / "docs" / "policies-results.md").read_text()
    capsys.readouterr()


@pytest.mark.slow
def test_ways_are_drawn_by_the_generator_they_are_given() -> None:
    policy = policy_bound.SampledEvidence()
    env = gym.make(f"sbm_gym:{policy_bound.WORLDS[policy_bound.WORLD]}", colours=False)
    ways = []
    for seed in (1, 1, 2):
        observation, info = env.reset(seed=3)
        steps = islice(rollout(env, policy, observation, info, np.random.default_rng(seed)), 6)
        ways.append([step.info["agent"]["position_m"].tolist() for step in steps])
    env.close()
    assert ways[0] == ways[1] != ways[2]


@pytest.mark.parametrize("name", ["map", "history"])
def test_ablations_differ_from_the_default_in_what_is_told_and_are_named_in_commands(name: str) -> None:
    env_id, file = "sbm_gym/Indoor-v0", f"agents/hyperparams/without_{name}.yaml"
    whole, part = read_hyperparameters(env_id), read_hyperparameters(env_id, SHIPPED_FILE.parents[2] / file)
    assert replace(part, env_wrapper=whole.env_wrapper) == whole
    assert part.env_wrapper == f"moves_and_looks_without_{name}"
    description = {"env": env_id, "seed": 0, "hyperparameters": asdict(replace(part, n_timesteps=50))}
    assert training_command(description).endswith(f"--steps 50 --seed 0 --envs {part.n_envs} --hyperparams {file}")
    description["hyperparameters"] = asdict(whole)
    assert "--hyperparams" not in training_command(description)
