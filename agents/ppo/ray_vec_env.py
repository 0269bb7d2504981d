"""Environments of training on the nodes of a Ray cluster.

What an environment does follows from the seed, the number of its episode and the actions in it. So a group of
environments whose process is lost, with its node or alone, is brought back elsewhere to where it was: its episodes are
begun again and played with the actions that they had. The rollout goes on, and training ends with the same weights.
"""

import contextlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import DummyVecEnv

from agents.ppo.envs import EnvConfig, make_training_env, spread
from agents.ppo.vec_env import EnvGroup, GroupedVecEnv
from labeling.cluster.cluster_config import ClusterConfig, SameThere
from labeling.cluster.ray_objects import RemoteObjects
from labeling.core.errors import SbmError
from labeling.runtime.process_pool import WorkerDiedError

MAX_ATTEMPTS = 3
"""So many processes in a row that are lost in the same step end the rollout."""
READING = ("get_attr", "env_is_wrapped")
"""Methods that leave environments as they are."""
Call = tuple[str, tuple[Any, ...]]
"""Name of a method of ``DummyVecEnv``, and its arguments."""


@contextlib.contextmanager
def ray_vec_env(
    config: EnvConfig,
    count: int,
    processes: int | None,
    where: ClusterConfig,
    common: Sequence[Path] = (),
    same: Sequence[SameThere] = (),
) -> Iterator[GroupedVecEnv]:
    """Several environments, spread over the processes of a cluster, each of these in one thread.

    Args:
        config: which environment.
        count: how many of it.
        processes: over how many they are spread at most; None is one for each core of the cluster.
        where: the cluster.
        common: files and folders that environments read.
        same: what must be the same on all nodes besides code, libraries and weights.

    Raises:
        SbmError: if there is no such cluster, or none of its nodes is as this machine.
    """
    limit = min(processes or count, count)
    with contextlib.closing(RemoteObjects(partial(make_group, config, count), limit, where, common, same)) as objects:
        parts = [range(part[0], part[-1] + 1) for part in spread(range(count), objects.num_processes)]
        yield GroupedVecEnv([RayGroup(objects, part) for part in parts], [len(part) for part in parts])


def make_group(config: EnvConfig, count: int, indices: range) -> DummyVecEnv:
    """Some of several training environments.

    Args:
        config: which environment.
        count: how many there are in all.
        indices: of these, counted from 0.
    """
    return DummyVecEnv([partial(make_training_env, config, index, count) for index in indices])  # type: ignore[list-item]


class RayGroup(EnvGroup):
    """A group of environments in a process of a cluster."""

    def __init__(self, objects: RemoteObjects, indices: range) -> None:
        """Starts nothing yet.

        Args:
            objects: those of the cluster.
            indices: of the environments.
        """
        self._objects, self._indices = objects, indices
        self._past = Past(len(indices))
        self._sent: Call = ("", ())

    def send(self, name: str, *arguments: Any) -> None:
        """Has it begin with a method."""
        self._sent = (name, arguments)
        self._objects.call(self._indices, name, *arguments)

    def receive(self) -> Any:
        """Waits for what the method returns; if the process is lost, it is done again in another.

        Raises:
            WorkerDiedError: if three processes in a row are lost.
            SbmError: if there is no node left, or environments do not do again what they did.
        """
        losses: list[str] = []
        while True:
            try:
                if losses:
                    self._catch_up()
                answer = self._objects.answer(self._indices)
            except WorkerDiedError as loss:
                losses.append(str(loss))
                if len(losses) == MAX_ATTEMPTS:
                    first, last = self._indices[0], self._indices[-1]
                    words = f"the process of environments {first} to {last} was lost {MAX_ATTEMPTS} times in one step"
                    raise WorkerDiedError(f"{words} ({'; '.join(losses)})") from None
                continue
            self._past.add(self._sent, answer)
            return answer

    def close(self) -> None:
        """Does nothing: environments end with their processes."""

    def _catch_up(self) -> None:
        """Brings new environments to where the lost ones were, and has them begin with what those had not finished."""
        answer = None
        for name, arguments in self._past.calls():
            self._objects.call(self._indices, name, *arguments)
            answer = self._objects.answer(self._indices)
        if not self._past.is_same(answer):
            raise SbmError(
                "a node was lost, and its environments do not do again what they did before with the same seed and "
                "actions, so that the rollout cannot go on; the same command goes on from the last checkpoint"
            )
        name, arguments = self._sent
        self._objects.call(self._indices, name, *arguments)


class Past:
    """All that environments were told and that decides what they do, as short as can be.

    What went before their last common beginning of episodes is told by the number of these.
    """

    def __init__(self, count: int) -> None:
        """Nothing yet.

        Args:
            count: how many environments.
        """
        self.seen: tuple[Any, ...] | None = None
        """What they showed last: observations and, unless an episode has just begun, rewards and which ended."""
        self._settings: list[Call] = []
        self._first = 0
        """Number of their first episodes."""
        self._episode: int | None = None
        """Number of the last episodes that all began together."""
        self._since: list[Call] = []
        """Steps since then."""
        self._ends = np.zeros(count, int)
        """How many episodes of each environment have ended since then."""

    def add(self, call: Call, answer: Any) -> None:
        """Environments have been told something, and have done it."""
        name, arguments = call
        if name == "env_method" and arguments[0] == "begin_at":
            self._first = arguments[1]
        elif name == "reset" and self._episode is None:
            self._episode, self.seen = self._first, (answer,)
        elif name in ("reset", "step"):
            self._since.append(call)
            ended = answer[2] if name == "step" else np.ones(len(self._ends), bool)
            seen = answer[:3] if name == "step" else (answer,)
            self._ends += ended
            if self._episode is not None and ended.all() and len(set(self._ends)) == 1:
                self._episode += int(self._ends[0])
                self._since, seen = [], seen[:1]
                self._ends[:] = 0
            self.seen = seen
        elif name not in READING:
            self._settings.append(call)

    def calls(self) -> list[Call]:
        """What brings new environments to where these are."""
        if self._episode is None:
            return [*self._settings, ("env_method", ("begin_at", self._first))]
        return [*self._settings, ("env_method", ("begin_at", self._episode)), ("reset", ()), *self._since]

    def is_same(self, answer: Any) -> bool:
        """Whether environments show what they showed last.

        Args:
            answer: to the last of ``calls``.
        """
        if self.seen is None:
            return True
        return same_content(answer[: len(self.seen)] if isinstance(answer, tuple) else (answer,), self.seen)


def same_content(one: Any, other: Any) -> bool:
    """Whether arrays are the same, or tuples and dicts of arrays."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same_content(one[name], other[name]) for name in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same_content, one, other))
    return np.array_equal(one, other, equal_nan=True)
