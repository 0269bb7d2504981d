"""What docs/gymnasium.md shows works."""

import re
from pathlib import Path

import cv2
import pytest

from ..imports import ROOT

BLOCKS = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "gymnasium.md").read_text(encoding="utf-8"), re.DOTALL)


def block(word: str) -> str:
    (found,) = (one for one in BLOCKS if word in one)
    return found


@pytest.mark.slow
def test_an_episode_is_filmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(block("RecordVideo"), names)
    film = cv2.VideoCapture(str(Path("FILMS") / "rl-video-episode-0.mp4"))
    frames = int(film.get(cv2.CAP_PROP_FRAME_COUNT))
    assert frames == 1 + 25  # of reset and of every step
    assert film.read()[1].shape == (240, 320, 3)


@pytest.mark.slow
def test_several_environments_step_at_once() -> None:
    names: dict = {}
    exec(block("make_vec"), names)
    assert names["rewards"].shape == (2,)
    assert names["observations"]["rgb"].shape[0] == 2


@pytest.mark.slow
def test_ppo_of_ones_own_has_the_actions_that_work() -> None:
    names: dict = {}
    exec(block("MovesAndLooks"), names)
    assert names["model"].num_timesteps == 100
    assert names["model"].action_space.nvec.tolist() == [9, 17]


@pytest.mark.slow
def test_a_policy_of_ones_own_is_compared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    """By ``sbm``, which finds it in the working directory."""
    import sys

    from experiments.sbm import main

    (tmp_path / "mine.py").write_text(block("mine.py"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path not in ("", str(tmp_path))])
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    settings = ["--env", "sbm_gym/IndoorBuiltin-v0", "--episodes", "1", "--scenes", "1", "--out", "BOARD"]
    assert main(["compare", "--policies", "mine:Forward", "spin", *settings]) == 0
    assert "mine:Forward" in capsys.readouterr().out
    assert sys.path[-1] == str(tmp_path)  # last: it hides nothing that is installed
    monkeypatch.delitem(sys.modules, "mine", raising=False)


def test_minaris_collector_is_given_what_its_files_can_hold() -> None:
    """Minari is no part of the lock file; the recipe's observations are pictures of three colours and vectors."""
    gymnasium = pytest.importorskip("gymnasium")
    recipe = block("minari")
    (keys,) = re.findall(r"FilterObservation\(world, \((.*?)\)\)", recipe)
    world = gymnasium.make("sbm_gym:sbm_gym/IndoorBuiltin-v0")
    env = gymnasium.wrappers.FilterObservation(world, tuple(key.strip(' "') for key in keys.split(",")))
    assert all(len(space.shape) == 1 or space.shape[2] == 3 for space in env.observation_space.values())
    compile(recipe, "minari", "exec")
    env.close()
