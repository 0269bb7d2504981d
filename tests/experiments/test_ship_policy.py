"""Shipping a trained policy: what is copied is the best checkpoint, and nothing else is ever taken for one."""

import json
import shutil
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.evaluation.statistics import paired_record
from agents.planning.promises import UNMAPPED
from agents.policies import registry
from agents.policies.registry import make_policy
from agents.ppo.config import PpoConfig
from agents.ppo.training import train_ppo
from experiments import ship_policy
from experiments.ship_policy import main, thinned
from labeling.core.errors import UsageError

from .box_env import SHORT_ENV_ID, write_hyperparams

NAME = SHORT_ENV_ID.rpartition("/")[2]


class Silent:
    """Takes the place of tqdm."""

    def __init__(self, *_, **__) -> None: ...

    def update(self, count: int) -> None: ...

    def set_postfix_str(self, text: str) -> None: ...

    def close(self) -> None: ...


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained")
    config = PpoConfig(
        out=folder / "run",
        env=SHORT_ENV_ID,
        steps=30,
        hyperparams=write_hyperparams(folder),
        eval_every=20,
        eval_episodes=2,
        scenes=2,
        validation_scenes=1,
        compare_episodes=0,
        seed=3,
    )
    train_ppo(config, lambda _: None, Silent)
    return folder / "run"


def ship(run: Path, folder: Path, *more: str) -> int:
    return main([str(run), "--weights", str(folder / "weights"), "--results", str(folder / "results"), *more])


@pytest.mark.slow
def test_the_best_policy_is_shipped_and_acts_like_it(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ship(trained, tmp_path) == 0
    shipped = tmp_path / "weights" / NAME
    assert {path.name for path in shipped.iterdir()} == {path.name for path in (trained / "best").iterdir()}
    assert all(path.suffix in (".json", ".safetensors") for path in shipped.iterdir())
    monkeypatch.setattr(registry, "WEIGHTS", tmp_path / "weights")
    env = gym.make(SHORT_ENV_ID, split="val")
    observation, info = env.reset(seed=1)
    actions = []
    for name in ("ppo", f"ppo:{trained / 'best'}"):
        policy = make_policy(name, SHORT_ENV_ID)
        policy.reset(env, observation, info, np.random.default_rng(0))
        actions.append(policy.act(observation, info))
    env.close()
    assert np.array_equal(*actions)


@pytest.mark.slow
def test_what_unseen_starts_showed_is_kept(trained: Path, tmp_path: Path) -> None:
    assert ship_policy.unseen_returns(trained) is None  # this run compares nothing
    run = tmp_path / "run"
    shutil.copytree(trained, run)
    (run / "unseen").mkdir()
    names = [f"ppo:{run}/best", f"ppo:{run}/first", "ring"]
    content = {
        "compared_with": names[0],
        "settings": {"episodes": 8, "scenes": ["a", "b"]},
        "policies": {name: {"figures": {"return": {"mean": 3.0 - at}}} for at, name in enumerate(names)},
        "pairs": {
            f"{names[1]} minus {names[0]}": {"return": {"mean": -1.0, "low": -1.5, "high": -0.5, "episodes": 8}},
            f"ring minus {names[0]}": {"return": {"mean": -2.0, "low": -4.5, "high": 0.5}},
            f"ring minus {names[1]}": {"return": {"mean": -1.0, "low": -3.0, "high": 1.0}},
        },
    }
    (run / "unseen" / "evaluation.json").write_text(json.dumps(content))
    assert ship_policy.unseen_returns(run) == {
        "starts": 8,
        "scenes": 2,
        "policies": {
            "best": {"return": 3.0, "above": None},
            "first": {"return": 2.0, "above": {"mean": 1.0, "low": 0.5, "high": 1.5, "episodes": 8}},
            "ring": {"return": 1.0, "above": {"mean": 2.0, "low": -0.5, "high": 4.5}},
        },
    }
    few = paired_record([1.0, 2.0, 3.0], [0.0, 0.5, 0.0], ["a", "b", "c"])
    assert few is not None
    content["pairs"][f"ring minus {names[0]}"] = {"return": few}
    (run / "unseen" / "evaluation.json").write_text(json.dumps(content))
    shipped = ship_policy.unseen_returns(run)
    assert shipped is not None
    above = shipped["policies"]["ring"]["above"]
    assert (above["mean"], above["low"], above["high"]) == (-few["mean"], None, None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "ending"),
    [({"reward": "evidence"}, "evidence"), ({"hyperparameters": {"env_wrapper": UNMAPPED}}, "unmapped")],
)
def test_what_a_policy_was_trained_for_decides_its_name(trained: Path, tmp_path: Path, change, ending) -> None:
    run = described_anew(trained, tmp_path / "run", change)
    assert ship(run, tmp_path) == 0
    assert [folder.name for folder in (tmp_path / "weights").iterdir()] == [f"{NAME}-{ending}"]


@pytest.mark.slow
def test_weights_that_no_policy_goes_by_are_not_shipped(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = {"reward": "evidence", "hyperparameters": {"env_wrapper": UNMAPPED}}
    run = described_anew(trained, tmp_path / "run", both)
    assert ship(run, tmp_path) == 2
    assert "no policy goes by weights of both" in capsys.readouterr().err
    assert not (tmp_path / "weights").exists()
    assert not (tmp_path / "results").exists()


def described_anew(trained: Path, run: Path, change: dict[str, Any]) -> Path:
    """A copy of a run whose best policy is said to have been trained otherwise."""
    shutil.copytree(trained, run)
    description = json.loads((run / "best" / "policy.json").read_text())
    hyperparameters = {**description["hyperparameters"], **change.get("hyperparameters", {})}
    description = {**description, **change, "hyperparameters": hyperparameters}
    (run / "best" / "policy.json").write_text(json.dumps(description))
    return run


@pytest.mark.slow
def test_a_training_from_another_seed_is_shipped_beside_it(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ship(trained, tmp_path) == 0
    assert ship(trained, tmp_path, "--as-seed") == 0
    shipped = tmp_path / "weights"
    assert {folder.name for folder in shipped.iterdir()} == {NAME, f"{NAME}-seed-3"}
    assert (tmp_path / "results" / f"policy_training_{NAME}-seed-3.json").is_file()
    monkeypatch.setattr(registry, "WEIGHTS", shipped)
    assert registry.checkpoint_of("ppo_seed_3", SHORT_ENV_ID) == shipped / f"{NAME}-seed-3"
    assert registry.checkpoint_of("ring_seed_3", SHORT_ENV_ID) is None
    with pytest.raises(UsageError, match="policy 'ppo_seed_4': no trained policy"):
        registry.checkpoint_of("ppo_seed_4", SHORT_ENV_ID)


@pytest.mark.slow
def test_the_record_tells_how_the_run_went(trained: Path, tmp_path: Path) -> None:
    assert ship(trained, tmp_path) == 0
    record = json.loads((tmp_path / "results" / f"policy_training_{NAME}.json").read_text())
    history = json.loads((trained / "history.json").read_text())
    assert [one["at"] for one in record["validations"]] == [one["at"] for one in history["validations"]]
    returns = [one["return"] for one in history["validations"]]
    assert record["best"]["return"] == max(returns)
    assert record["checkpoint"]["steps"] == record["best"]["at"]
    assert record["rollouts_in_all"] == len(record["rollouts"]) == len(history["rollouts"])
    assert list(record["references"]) == ["random", "ring", "next_best_view"]
    for name, figures in record["references"].items():
        assert figures["return"] == pytest.approx(history["baselines"][name]["return"], abs=1e-4)
    assert record["settings"]["seed"] == 3
    assert f"--env {SHORT_ENV_ID} --steps 30 --seed 3" in record["command"]
    assert str(trained) not in json.dumps(record)


@pytest.mark.slow
def test_the_latest_policy_is_shipped_without_what_only_training_needs(trained: Path, tmp_path: Path) -> None:
    assert ship(trained, tmp_path, "--checkpoint", "last") == 0
    record = json.loads((tmp_path / "results" / f"policy_training_{NAME}.json").read_text())
    assert record["checkpoint"]["steps"] == json.loads((trained / "last" / "policy.json").read_text())["steps"]
    names = {path.name for path in (tmp_path / "weights" / NAME).iterdir()}
    assert "training.pt" in {path.name for path in (trained / "last").iterdir()} - names
    weights = [folder / "policy.safetensors" for folder in (trained / "last", tmp_path / "weights" / NAME)]
    assert weights[0].read_bytes() == weights[1].read_bytes()


@pytest.mark.slow
def test_how_a_run_went_can_be_kept_without_shipping_it(trained: Path, tmp_path: Path) -> None:
    assert ship(trained, tmp_path, "--weights", "None", "--record", "Boxes_seed_3") == 0
    record = json.loads((tmp_path / "results" / "policy_training_Boxes_seed_3.json").read_text())
    assert record["shipped"] is False
    assert record["settings"]["seed"] == 3
    assert [path.name for path in tmp_path.iterdir()] == ["results"]


@pytest.mark.slow
def test_shipping_again_replaces_what_was_there(trained: Path, tmp_path: Path) -> None:
    old = tmp_path / "weights" / NAME
    old.mkdir(parents=True)
    (old / "older.json").write_text("{}")
    assert ship(trained, tmp_path) == 0
    assert not (old / "older.json").exists()
    assert [path.name for path in (tmp_path / "weights").iterdir()] == [NAME]


def spoil(run: Path, how: str) -> None:
    best = run / "best"
    if how == "no run":
        shutil.rmtree(run)
    elif how == "no checkpoint":
        shutil.rmtree(best)
    elif how == "foreign file":
        (best / "notes.txt").write_text("mine")
    elif how == "damaged weights":
        (best / "policy.safetensors").write_bytes(b"no tensors")
    elif how == "strange env":
        description = json.loads((best / "policy.json").read_text())
        (best / "policy.json").write_text(json.dumps({**description, "env": "x/../../etc"}))
    elif how == "no history":
        (run / "history.json").unlink()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("no run", "give the folder of a run"),
        ("no checkpoint", "give the folder of a run"),
        ("foreign file", "notes.txt"),
        ("damaged weights", "policy.safetensors"),
        ("strange env", "no id of an env"),
        ("no history", "history.json"),
    ],
)
def test_what_is_no_run_is_refused_in_one_sentence(
    how: str, says: str, trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(trained, tmp_path / "run")
    spoil(tmp_path / "run", how)
    assert ship(tmp_path / "run", tmp_path) == 2
    error = capsys.readouterr().err
    assert says in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "weights").exists()
    assert not (tmp_path / "results").exists()


@pytest.mark.slow
def test_large_checkpoints_are_refused(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    size = sum(path.stat().st_size for path in (trained / "best").iterdir())
    monkeypatch.setattr(ship_policy, "MAX_MB", size / 1e6 - 1e-6)
    assert ship(trained, tmp_path) == 2
    assert "smaller network" in capsys.readouterr().err
    assert not (tmp_path / "weights").exists()


def test_thinning_keeps_ends_and_order() -> None:
    for length in (1, 2, 399, 400, 401, 1234):
        points = list(range(length))
        kept = thinned(points, 400)
        assert len(kept) == min(length, 400)
        assert (kept[0], kept[-1]) == (0, length - 1)
        assert kept == sorted(set(kept))
