"""Playing by the keyboard: what keys do, and a whole game without a screen."""

import itertools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from agents.play import main
from agents.rollouts.keyboard import NO_MOVE, PictureWindow, keys_to_action
from sbm_gym.env.fixation_env import FixationEnv

from ...sbm_gym.box_rooms import BoxRooms

OPPOSITES = ("ws", "ad", "qe", "rf")


def test_every_set_of_keys_that_do_not_contradict_each_other_is_an_action_of_the_world() -> None:
    env = gym.make("sbm_gym:sbm_gym/IndoorBuiltin-v0")
    found = keys_to_action()
    sets = {frozenset(keys) for keys in found}
    expected = {
        frozenset(keys)
        for count in range(1, 5)
        for keys in itertools.combinations("wsadqerf", count)
        if not any(set(pair) <= set(keys) for pair in OPPOSITES)
    }
    assert sets == expected
    assert len(found) == len(sets)
    assert all(action in env.action_space for action in found.values())
    env.close()


def test_keys_add_up_and_opposite_keys_are_opposite() -> None:
    found = {frozenset(keys): action for keys, action in keys_to_action().items()}
    for keys, action in found.items():
        np.testing.assert_array_equal(action, sum(found[frozenset(key)] for key in keys))
    for axis, (one, other) in enumerate(OPPOSITES):
        np.testing.assert_array_equal(found[frozenset(one)], -found[frozenset(other)])
        # As the environment counts its actions: forward, left, gaze to the left and up are positive.
        assert np.flatnonzero(found[frozenset(one)]).tolist() == [axis]
        assert found[frozenset(one)][axis] > 0


def test_without_a_screen_it_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("platform.system", lambda: "Linux")
    assert main([]) == 2
    assert "there is no screen here" in capsys.readouterr().err


@pytest.mark.nightly
@pytest.mark.parametrize("view", ["eyes", "above"])
def test_a_game_steps_as_keys_are_pressed_and_ends_with_escape(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], view: str
) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")

    def down(key: str) -> object:
        return pygame.event.Event(pygame.KEYDOWN, key=ord(key))

    def up(key: str) -> object:
        return pygame.event.Event(pygame.KEYUP, key=ord(key))

    ended = pygame.event.Event(pygame.KEYDOWN, key=pygame.K_ESCAPE)
    # Of each frame: none yet, forward, forward and left, nothing, nothing, the end.
    script = iter([[], [down("w")], [down("q")], [up("w"), up("q")], [], [ended]])
    monkeypatch.setattr(pygame.event, "get", lambda: next(script))
    actions: list[np.ndarray] = []
    step, reset = PictureWindow.step, FixationEnv.reset
    seeds: list[int | None] = []

    def noted(self: FixationEnv, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        seeds.append(seed)
        return reset(self, seed=seed, options=options)

    monkeypatch.setattr(FixationEnv, "reset", noted)
    monkeypatch.setattr(PictureWindow, "step", lambda self, action: (actions.append(action), step(self, action))[1])
    assert main(["--view", view, "--seed", "3", "--zoom", "0.5"]) == 0
    known = {frozenset(keys): action for keys, action in keys_to_action().items()}
    assert [action.tolist() for action in actions] == [known[frozenset(keys)].tolist() for keys in ("w", "wq")]
    said = capsys.readouterr().out
    assert "keys: w/s" in said
    assert [line.split(":")[0] for line in said.splitlines() if line.startswith("step")] == ["step 1", "step 2"]
    assert next(script, None) is None
    assert set(seeds) == {3}


def test_another_episode_follows_each(monkeypatch: pytest.MonkeyPatch) -> None:
    window = PictureWindow(FixationEnv(BoxRooms(), num_views=2))
    starts = []
    for _ in range(3):  # what Gymnasium's player does
        _, info = window.reset(seed=7)
        starts.append((info["scene"], *window.unwrapped.simulation.trace().camera.camera_to_world[:2, 3]))  # type: ignore[attr-defined]
        for _ in range(2):
            window.step(NO_MOVE)
    window.close()
    assert len(set(starts)) == 3
    again = PictureWindow(FixationEnv(BoxRooms(), num_views=2))
    again.reset(seed=7)
    _, info = again.reset(seed=7)  # before the first step, the same episode begins again
    found = (info["scene"], *again.unwrapped.simulation.trace().camera.camera_to_world[:2, 3])  # type: ignore[attr-defined]
    again.close()
    assert found == starts[0]
