"""Statistics of an episode in training and validation, and their means over episodes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

TERM_PREFIX = "reward/"
"""Prefix of the names of reward terms."""


class EpisodeStatistics:
    """Adds up an episode, step by step."""

    def __init__(self) -> None:
        """Starts before the first step."""
        self._return = 0.0
        self._steps = self._collisions = 0
        self._terms: dict[str, float] = {}
        self._info: dict[str, Any] = {}

    def add(self, reward: float, info: dict[str, Any]) -> None:
        """Adds one step.

        Args:
            reward: of the step.
            info: of the step, as ``FixationEnv`` gives it.
        """
        self._return += reward
        self._steps += 1
        self._collisions += bool(info["collided"])
        for name, value in info["reward_terms"].items():
            self._terms[name] = self._terms.get(name, 0.0) + value
        self._info = info

    def result(self) -> dict[str, float]:
        """Sums and final values by name; the episode is a success if an object was confirmed."""
        return {
            "return": self._return,
            "success": float(self._info["is_success"]),
            "coverage": float(self._info["coverage"]),
            "objects_confirmed": float(len(self._info["confirmed_objects"])),
            "collisions": float(self._collisions),
            "path_length_m": float(self._info["path_length_m"]),
            "steps": float(self._steps),
        } | {TERM_PREFIX + name: value for name, value in self._terms.items()}


def means(episodes: Sequence[dict[str, float]]) -> dict[str, float]:
    """The mean of every statistic over at least one episode."""
    return {name: float(np.mean([episode[name] for episode in episodes])) for name in episodes[0]}
