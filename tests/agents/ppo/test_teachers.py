"""Teachers side by side show what each would show alone."""

import contextlib
from pathlib import Path

import gymnasium as gym
import numpy as np

from agents.ppo.teachers import Teacher, Teachers
from agents.ppo.workers import EnvSettings

from ..toy_world import ENV_ID


def test_teachers_in_processes_show_what_they_show_here(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1]))
    settings = EnvSettings(f"toy_world:{ENV_ID}")
    assert ENV_ID in gym.registry
    with contextlib.closing(Teachers(settings, "random", 2)) as teachers:
        shown = dict(teachers.show(range(5), 7, ("state",), None))
    assert sorted(shown) == list(range(5))
    here = Teacher(settings, "random", 0, 2)
    for number, part in shown.items():
        again = here.show(number, 7, ("state",), None)
        assert set(part.observations) == {"state"}
        assert np.array_equal(part.observations["state"], again.observations["state"])
        assert np.array_equal(part.actions, again.actions)
        assert np.array_equal(part.rewards[0], again.rewards[0])
