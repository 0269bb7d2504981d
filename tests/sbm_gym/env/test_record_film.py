"""Films of episodes: which are filmed, what they show, and that a film never stops a training."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from PIL import Image

import sbm_gym
from labeling.core.errors import UsageError
from labeling.formats import film


class Counter(gymnasium.Env):
    """An environment whose picture tells the step; episodes of three steps."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - as Gymnasium has it
    observation_space = gymnasium.spaces.Discrete(100)
    action_space = gymnasium.spaces.Discrete(2)

    def __init__(self, render_mode: str | None = "rgb_array") -> None:
        self.render_mode, self.steps = render_mode, 0

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[int, dict]:
        self.steps = 0
        return 0, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict]:
        self.steps += 1
        return self.steps, 1.0, self.steps == 3, False, {}

    def render(self) -> np.ndarray:  # type: ignore[override]
        return np.full((20, 30, 3), 60 * self.steps, np.uint8)


def play(env: gymnasium.Env, episodes: int, steps: int = 3) -> None:
    for _ in range(episodes):
        env.reset()
        for _ in range(steps):
            env.step(0)


def shown(file: Path) -> list[int]:
    """The step that each picture of a film tells."""
    with Image.open(file) as pictures:
        found = []
        for number in range(pictures.n_frames):
            pictures.seek(number)
            found.append(round(float(np.asarray(pictures.convert("RGB")).mean()) / 60))
        return found


def test_the_episodes_asked_for_are_filmed_from_reset_to_end(tmp_path: Path) -> None:
    env = sbm_gym.RecordFilm(Counter(), tmp_path / "films", lambda episode: episode in (1, 3), "run")
    play(env, 5)
    env.close()
    assert sorted(path.name for path in (tmp_path / "films").iterdir()) == ["run-episode-1.gif", "run-episode-3.gif"]
    assert shown(tmp_path / "films" / "run-episode-3.gif") == [0, 1, 2, 3]


def test_an_episode_that_is_left_is_filmed_as_far_as_it_went(tmp_path: Path) -> None:
    env = sbm_gym.RecordFilm(Counter(), tmp_path, lambda _: True)
    play(env, 1, steps=2)
    play(env, 1, steps=1)
    env.close()
    assert shown(tmp_path / "rl-video-episode-0.gif") == [0, 1, 2]
    assert shown(tmp_path / "rl-video-episode-1.gif") == [0, 1]


def test_by_default_cubic_numbers_are_filmed_as_by_gymnasium(tmp_path: Path) -> None:
    env = sbm_gym.RecordFilm(Counter(), tmp_path)
    play(env, 10)
    env.close()
    assert {path.name for path in tmp_path.iterdir()} == {f"rl-video-episode-{number}.gif" for number in (0, 1, 8)}


def test_what_draws_no_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="render_mode 'rgb_array' or 'third_person', not None"):
        sbm_gym.RecordFilm(Counter(None), tmp_path)


def test_a_film_too_large_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "MAX_MB", 1e-6)
    env = sbm_gym.RecordFilm(Counter(), tmp_path, lambda _: True)
    with pytest.warns(UserWarning, match="no film of episode 0: .*film a shorter episode"):
        play(env, 1)
    assert not list(tmp_path.iterdir())


def test_the_wrapper_is_part_of_the_specification(tmp_path: Path) -> None:
    """So that an environment can be made again from ``env.spec``."""
    env = gymnasium.make("sbm_gym/IndoorBuiltin-v0", render_mode="rgb_array")
    wrapped = sbm_gym.RecordFilm(env, str(tmp_path))
    assert wrapped.spec is not None
    assert [one.name for one in wrapped.spec.additional_wrappers] == ["RecordFilm"]
    wrapped.close()
