"""Environments that command lines name: those of modules of one's own, and what is refused in one line."""

import sys
from pathlib import Path

import gymnasium as gym
import pytest

from labeling.core.errors import UsageError
from sbm_gym import ENV_IDS, build_atlas, fit_simulated
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.named_env import make_env
from sbm_gym.scenes.__main__ import main as scenes
from sbm_gym.scenes.env_names import registered_id
from sbm_gym.scenes.world_sources import WORLDS

from .box_rooms import BoxRooms

MODULE = """
import sbm_gym

def build(scene):
    def furnish(layout, library):
        layout.against_wall(library.models("couch")[0])
    return sbm_gym.build_room(scene, (5.0, 4.0), furnish)

sbm_gym.register_world("NamedArena", build, {"train": ["arena/0", "arena/1"]})
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    name = "module_of_ones_own"
    (tmp_path / f"{name}.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield name
    sys.modules.pop(name, None)
    for known, key in (
        (ENV_IDS, "sbm_gym/NamedArena-v0"),
        (WORLDS, "NamedArena"),
        (gym.registry, "sbm_gym/NamedArena-v0"),
    ):
        known.pop(key, None)  # type: ignore[attr-defined]


def test_commands_know_a_world_of_ones_own_by_its_module(module, capsys):
    assert scenes(["list", "--env", f"{module}:sbm_gym/NamedArena-v0"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["arena/0", "arena/1"]
    assert registered_id(f"{module}:sbm_gym/NamedArena-v0") == "sbm_gym/NamedArena-v0"
    assert scenes(["build", "--env", f"{module}:sbm_gym/NamedArena-v0"]) == 2
    assert "of which no compiled scenes are kept" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("env_id", "says"),
    [
        ("CartPole-v1", "'CartPole-v1' has no scenes"),
        ("no_such_module:Foo-v0", "cannot import 'no_such_module'"),
        (".x:Foo-v0", "cannot import '.x'"),
        ("sbm_gym/Moon-v0", "unknown env 'sbm_gym/Moon-v0'; known: sbm_gym/"),
    ],
)
def test_what_is_no_world_is_one_line_of_every_command(env_id, says, tmp_path, capsys):
    out = tmp_path / "out"
    for main, arguments in (
        (build_atlas.main, ["--env", env_id, "--out", str(out)]),
        (fit_simulated.main, ["--env", env_id, "--out", str(out)]),
        (scenes, ["list", "--env", env_id]),
    ):
        assert main(arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert says in line
    assert not out.exists()
    with pytest.raises(UsageError, match="unknown detector"):
        make_env("sbm_gym/IndoorBuiltin-v0", "train", "nobody")


def test_an_environment_that_cannot_be_made_is_one_line():
    gym.register("named_env_test/Gone-v0", entry_point="no_such_module:Env")
    try:
        with pytest.raises(UsageError, match="cannot be made"):
            make_env("named_env_test/Gone-v0", "train", "simulated")
    finally:
        gym.registry.pop("named_env_test/Gone-v0")


def test_counts_out_of_range_and_worlds_with_few_scenes_are_refused(module, tmp_path, capsys):
    env_id, out = f"{module}:sbm_gym/NamedArena-v0", str(tmp_path / "out")
    for main, flags, says in (
        (build_atlas.main, ["--skip", "-2"], "--skip"),
        (build_atlas.main, ["--scenes", "0"], "--scenes"),
        (fit_simulated.main, ["--scenes", "0"], "--scenes"),
        (fit_simulated.main, ["--places", "0"], "--places"),
        (fit_simulated.main, ["--detector", "simulated"], "has 2 scenes in its split 'endless'"),
    ):
        assert main(["--env", env_id, "--out", out, *flags]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert says in line


@pytest.mark.parametrize("steps", [4, 40])
def test_an_episode_is_as_long_as_its_registration_says(steps):
    env_id = f"named_env_test/Boxes{steps}-v0"
    gym.register(
        env_id,
        entry_point="sbm_gym.env.fixation_env:FixationEnv",
        kwargs={"worlds": BoxRooms(2)},
        max_episode_steps=steps,
    )
    try:
        env = gym.make(env_id)
        inner = env.unwrapped
        assert isinstance(inner, FixationEnv)
        assert inner.num_views == steps
        env.reset(seed=0)
        for step in range(1, steps + 1):
            *_, truncated, _ = env.step(env.action_space.sample())
            assert truncated == (step == steps)
            assert inner.knowledge.views_left == steps - step
        env.close()
    finally:
        gym.registry.pop(env_id)
