"""The experiments about policies run, resume, never look at test scenes, and sum up what the episodes say."""

import json
from pathlib import Path

import numpy as np
import pytest

from agents.evaluation.run import Player
from agents.evaluation.store import read_result
from experiments import policy_evaluation, reward_ablation
from experiments.run import main
from experiments.trained_policies import training_command
from labeling.paired import paired_difference

from .box_env import ENV_ID, SHORT_ENV_ID, write_hyperparams


def run(name: str, folder: Path, seeds: int = 1) -> int:
    places = [f"--{place}={folder / place}" for place in ("cache", "results", "docs")]
    return main([name, "--scale", "smoke", "--seeds", str(seeds), "--workers", "1", *places])


def test_policies_are_compared_and_results_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(policy_evaluation, "WORLDS", {"boxes": ENV_ID})
    monkeypatch.setattr(policy_evaluation, "DETECTOR", "simulated")
    monkeypatch.setattr(policy_evaluation, "POLICIES", ("ring", "random", "spin", "ppo"))
    monkeypatch.setattr(policy_evaluation, "LABELLED", ("ring", "random", "ppo"))
    assert run("policy_evaluation", tmp_path) == 0
    content = json.loads((tmp_path / "results" / "policy_evaluation.json").read_text())
    boxes = content["worlds"]["boxes"]
    assert boxes["settings"]["split"] == "val"
    assert boxes["settings"]["scenes"] == ["box_3"]
    assert list(boxes["policies"]) == ["ring", "random", "spin"]
    assert boxes["policies"]["spin"]["labels"] is None
    assert "no trained policy" in boxes["left_out"]["ppo"]
    assert boxes["trained"] == {}
    assert list(boxes["policies"]["ring"]["labels"]) == ["5", "10", "12", "15", "20", "25"]
    (file,) = (tmp_path / "cache" / "policy_evaluation").rglob("random/*.json")
    figures = boxes["policies"]["random"]["figures"]
    for name, value in read_result(file)["figures"].items():
        assert figures[name]["mean"] == pytest.approx(value, abs=1e-4)
    early = boxes["policies"]["random"]["early"]
    assert (early["views"], early["base_views"]) == (12, 25)
    labels = {policy: found["labels"] for policy, found in boxes["policies"].items() if found["labels"]}
    expected = labels["random"]["12"]["right"]["mean"] - labels["ring"]["25"]["right"]["mean"]
    assert early["difference"]["right"]["mean"] == pytest.approx(expected)
    page = (tmp_path / "docs" / "policies-results.md").read_text()
    assert "`ppo` is left out" in page
    monkeypatch.setattr(Player, "play", None)  # a second run has nothing left to do
    assert run("policy_evaluation", tmp_path) == 0
    again = json.loads((tmp_path / "results" / "policy_evaluation.json").read_text())
    assert again["worlds"] == content["worlds"]
    capsys.readouterr()


def test_rewards_are_compared_by_the_last_policies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(reward_ablation, "ENV", SHORT_ENV_ID)
    monkeypatch.setattr(reward_ablation, "HYPERPARAMS", write_hyperparams(tmp_path))
    monkeypatch.setattr(reward_ablation, "REWARDS", ("both", "neither"))
    assert run("reward_ablation", tmp_path, seeds=2) == 0
    content = json.loads((tmp_path / "results" / "reward_ablation.json").read_text())
    assert [(one["reward"], one["seed"]) for one in content["runs"]] == [
        (reward, seed) for reward in ("both", "neither") for seed in (0, 1)
    ]
    assert {one["steps"] for one in content["runs"]} == {20}
    played = {path.parent.name: read_result(path)["figures"] for path in (tmp_path / "cache").rglob("seed0-0000.json")}
    assert len(played) == 4 + len(reward_ablation.REFERENCES)
    from agents.evaluation.store import policy_key

    for reward, figures in content["rewards"].items():
        for name, found in figures.items():
            for seed, value in enumerate(found["per_seed"]):
                (folder,) = (tmp_path / "cache" / "reward_ablation").glob(f"*/{reward}-{seed}")
                key = policy_key(f"ppo:{folder / 'last'}", SHORT_ENV_ID)
                assert value == pytest.approx(played[key][name], abs=1e-4)
            assert found["mean"] == pytest.approx(np.mean(found["per_seed"]), abs=1e-4)
            if reward != "both":
                gaps = np.subtract(found["per_seed"], content["rewards"]["both"][name]["per_seed"])
                assert found["difference"]["mean"] == pytest.approx(gaps.mean(), abs=1e-4)
                assert found["difference"]["std"] == pytest.approx(gaps.std(ddof=1), abs=1e-4)
    for name, value in content["references"]["ring"].items():
        assert value == pytest.approx(played["ring"][name], abs=1e-4)
    for seed in range(2):
        (history,) = (tmp_path / "cache" / "reward_ablation").glob(f"*/both-{seed}/history.json")
        first = json.loads(history.read_text())["validations"][0]
        assert first["at"] == 0
        assert content["start"]["objects"]["per_seed"][seed] == pytest.approx(first["objects_confirmed"], abs=1e-4)
    monkeypatch.setattr("agents.ppo.training.train", None)  # a second run has nothing left to do
    monkeypatch.setattr(Player, "play", None)
    assert run("reward_ablation", tmp_path, seeds=2) == 0
    again = json.loads((tmp_path / "results" / "reward_ablation.json").read_text())
    assert again["rewards"] == content["rewards"]
    capsys.readouterr()


def test_longer_runs_are_other_runs(tmp_path: Path) -> None:
    sizes = [reward_ablation.SIZES[scale].steps for scale in ("smoke", "quick", "full")]
    assert len(set(sizes)) == 3
    assert policy_evaluation.SPLIT == reward_ablation.SPLIT == "val"


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


def test_bootstrap_interval_by_brute_force() -> None:
    rng = np.random.default_rng(5)
    ours, theirs = rng.normal(size=12), rng.normal(size=12)
    found = paired_difference(ours.tolist(), theirs.tolist())
    assert found is not None
    means = [np.mean(rng.choice(ours - theirs, 12)) for _ in range(20_000)]
    assert found.low == pytest.approx(np.quantile(means, 0.025), abs=0.05)
    assert found.high == pytest.approx(np.quantile(means, 0.975), abs=0.05)
