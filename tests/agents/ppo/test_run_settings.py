"""Settings of a run: what it is begun with, and what may be given when it goes on."""

import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import pytest

from agents.network.files import SETTINGS_FILE
from agents.ppo import training
from agents.ppo.config import KEPT, KeptOptions, PpoConfig
from agents.ppo.run_settings import claim_run, resolve_settings
from agents.train import HELP
from labeling.core.errors import UsageError
from labeling.runtime.help import help_text

from ..toy_world import ENV_ID

OTHERS = {
    "env": "sbm_gym/Indoor-v0",
    "detector": "compact",
    "reward": "evidence",
    "seed": 3,
    "scenes": 7,
    "validation_scenes": 5,
    "eval_every": 800,
    "eval_episodes": 11,
}
"""Of all kept options that have a default, another value."""
DEFAULTS = [(name, getattr(KeptOptions, name)) for name in OTHERS]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Begun with nothing as it is by default."""
    settings = resolve_settings(PpoConfig(out=tmp_path / "run", **OTHERS))  # type: ignore[arg-type]
    claim_run(settings, {})
    return settings.folder


def test_options_that_are_not_given_are_as_help_says() -> None:
    assert set(OTHERS) == set(KEPT) - {"atlas"}
    assert resolve_settings(PpoConfig()).options == KeptOptions()
    told = " ".join(help_text(PpoConfig, "train", HELP).split())
    for name, value in DEFAULTS:
        explained = told.split(f" --{name.replace('_', '-')} ")[1].split(" --")[0]
        assert "by default " in explained
        assert str(value) in explained.split("by default ")[1]
    assert "{None" not in told


@pytest.mark.parametrize(("name", "value"), DEFAULTS)
def test_an_option_that_contradicts_the_run_is_refused_even_at_its_default(run: Path, name: str, value: object) -> None:
    config = PpoConfig(resume=run, **{name: value})  # type: ignore[arg-type]
    if name == "eval_every":
        assert resolve_settings(config).options == KeptOptions(**{**OTHERS, name: value})  # type: ignore[arg-type]
        return
    option = name.replace("_", "-")
    with pytest.raises(UsageError, match=f"--{option} {value} cannot be given with --resume .* as it was begun"):
        resolve_settings(config)


def test_a_run_goes_on_with_what_it_was_begun_with_named_or_not(run: Path) -> None:
    unnamed, named = (resolve_settings(PpoConfig(resume=run, **given)) for given in ({}, OTHERS))  # type: ignore[arg-type]
    assert unnamed == named
    assert unnamed.options == KeptOptions(**OTHERS)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="--atlas somewhere cannot be given"):
        resolve_settings(PpoConfig(resume=run, atlas=Path("somewhere")))


def test_validations_may_become_rarer_when_a_run_goes_on(run: Path) -> None:
    settings = resolve_settings(PpoConfig(resume=run, eval_every=1600))
    claim_run(settings, {})
    assert resolve_settings(PpoConfig(resume=run)).options.eval_every == 1600


def test_another_detector_of_the_same_name_is_refused(run: Path) -> None:
    settings = resolve_settings(PpoConfig(resume=run))
    assert "weights" not in json.loads((run / SETTINGS_FILE).read_text())  # as of runs begun before it was kept
    claim_run(settings, {"detector_digest": "one"})
    claim_run(settings, {"detector_digest": "one"})
    with pytest.raises(UsageError, match=r"detector_digest one there, another now") as told:
        claim_run(settings, {"detector_digest": "another"})
    assert "\n" not in str(told.value)
    assert json.loads((run / SETTINGS_FILE).read_text())["weights"] == {"detector_digest": "one"}


def test_what_stands_behind_a_detector_is_asked_where_there_is_one(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "digest_of_detector", lambda name: {"compact": "weights"}.get(name, ""))
    settings = resolve_settings(PpoConfig(resume=run))

    class WithDetector(gym.Env):
        categories = ("chair",)

    assert training._digests(settings, WithDetector()) == {"detector_digest": "weights"}
    simulated = replace(settings, options=replace(settings.options, detector="simulated"))
    assert training._digests(simulated, WithDetector()) == {}
    assert training._digests(settings, gym.make(ENV_ID)) == {}


@pytest.mark.parametrize(("envs", "says"), [(1, "4"), (2, "4"), (3, "4"), (6, "4 or 8"), (17, "16 or 20")])
def test_numbers_of_environments_that_do_not_fit_name_those_that_do(envs: int, says: str) -> None:
    with pytest.raises(UsageError, match=f"; give --envs {says}, or other hyperparameters"):
        resolve_settings(PpoConfig(envs=envs))
    for number in says.split(" or "):
        assert resolve_settings(PpoConfig(envs=int(number))).hyperparameters.n_envs == int(number)
