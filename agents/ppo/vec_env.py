"""Many environments in a few groups: those of a group step in turn, the groups side by side."""

import multiprocessing
import signal
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import CloudpickleWrapper, DummyVecEnv, VecEnv

from labeling.runtime.interrupts import STOPPING


class EnvGroup(ABC):
    """A ``DummyVecEnv`` somewhere else, which does one thing at a time."""

    @abstractmethod
    def send(self, name: str, *arguments: Any) -> None:
        """Has it begin with a method."""

    @abstractmethod
    def receive(self) -> Any:
        """Waits for what the method returns."""

    @abstractmethod
    def close(self) -> None:
        """Ends it."""


class GroupedVecEnv(VecEnv):
    """What ``DummyVecEnv`` does with the same environments, in several groups.

    An environment behaves the same whichever group it is in, so results do not depend on their number.
    """

    def __init__(self, groups: Sequence[EnvGroup], sizes: Sequence[int]) -> None:
        """Takes over groups; closing this closes them.

        Args:
            groups: of environments, in order.
            sizes: how many environments each has.
        """
        self._groups = groups
        ends = np.cumsum(sizes)
        self._parts = [slice(int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)]
        self._closed = False
        spaces = (self._call("get_attr", name)[0][0] for name in ("observation_space", "action_space"))
        super().__init__(sum(sizes), *spaces)

    def reset(self) -> Any:
        """Starts an episode in every environment."""
        return _joined(self._call("reset"))

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seeds the next ``reset``: environment i gets the seed + i."""
        if seed is None:
            seed = int(np.random.randint(0, np.iinfo(np.int32).max))  # noqa: NPY002, as Stable-Baselines3 has it
        arguments = [(seed + part.start,) for part in self._parts]
        return [one for seeds in self._exchange("seed", arguments) for one in seeds]

    def step_async(self, actions: np.ndarray) -> None:
        """Has every environment begin a step."""
        for group, part in zip(self._groups, self._parts, strict=True):
            group.send("step", actions[part])

    def step_wait(self) -> Any:
        """Observations, rewards, whether episodes ended, and infos of the step that was begun."""
        found = [group.receive() for group in self._groups]
        observations, rewards, ends, infos = zip(*found, strict=True)
        return _joined(observations), np.concatenate(rewards), np.concatenate(ends), [i for part in infos for i in part]

    def close(self) -> None:
        """Ends the groups."""
        if self._closed:
            return
        self._closed = True
        for group in self._groups:
            group.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the environments asked for."""
        found = [one for part in self._call("get_attr", attr_name) for one in part]
        return [found[index] for index in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets an attribute of all environments; of some is not offered."""
        self._refuse_some(indices)
        self._call("set_attr", attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Calls a method of all environments, with positional arguments; of some is not offered."""
        self._refuse_some(indices)
        assert not method_kwargs
        return [one for part in self._call("env_method", method_name, *method_args) for one in part]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Any = None) -> list[bool]:
        """Which of the environments asked for have a wrapper."""
        found = [one for part in self._call("env_is_wrapped", wrapper_class) for one in part]
        return [found[index] for index in self._get_indices(indices)]

    def _refuse_some(self, indices: Any) -> None:
        if indices is not None:
            raise NotImplementedError("environments are addressed all together")

    def _call(self, name: str, *arguments: Any) -> list[Any]:
        return self._exchange(name, [arguments] * len(self._groups))

    def _exchange(self, name: str, arguments: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Calls a method of every group, with arguments of its own; returns what each says."""
        for group, given in zip(self._groups, arguments, strict=True):
            group.send(name, *given)
        return [group.receive() for group in self._groups]


class ProcessGroup(EnvGroup):
    """A group of environments in a process of this machine."""

    def __init__(self, factories: Sequence[Callable[[], gym.Env]]) -> None:
        """Starts the process.

        Args:
            factories: make the environments, in that process.
        """
        context = multiprocessing.get_context("spawn")
        self._remote, there = context.Pipe()
        arguments = (there, self._remote, CloudpickleWrapper(list(factories)))
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        there.close()
        self._is_busy = False

    def send(self, name: str, *arguments: Any) -> None:
        """Has it begin with a method."""
        self._remote.send((name, arguments))
        self._is_busy = True

    def receive(self) -> Any:
        """Waits for what the method returns.

        Raises:
            EOFError: if the process has died.
        """
        found = self._remote.recv()
        self._is_busy = False
        return found

    def close(self) -> None:
        """Ends the process, once it has done what it was told."""
        if self._is_busy:
            self._remote.recv()
        self._remote.send(None)
        self._process.join()


def _joined(parts: Iterable[Any]) -> Any:
    """Observations of all processes as one batch."""
    parts = list(parts)
    if isinstance(parts[0], dict):
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return np.concatenate(parts)


def _serve(remote: Connection, parent: Connection, factories: CloudpickleWrapper) -> None:
    """Steps the environments of a process as it is told."""
    for one in STOPPING:  # the parent decides when to stop, and ends this process by closing the pipe
        signal.signal(one, signal.SIG_IGN)
    parent.close()
    envs = DummyVecEnv(factories.var)
    while True:
        try:
            told = remote.recv()
        except EOFError:  # the other side has died
            break
        if told is None:
            break
        name, arguments = told
        remote.send(getattr(envs, name)(*arguments))
    envs.close()
    remote.close()
