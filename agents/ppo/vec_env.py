"""Many environments in a few processes: those of a process step in turn, the processes side by side."""

import multiprocessing
from collections.abc import Callable, Iterable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import gymnasium as gym
import numpy as np
from stable_baselines3.common.vec_env import CloudpickleWrapper, DummyVecEnv, VecEnv


class ProcessVecEnv(VecEnv):
    """What ``DummyVecEnv`` does with the same environments, in several processes.

    An environment behaves the same whichever process it is in, so results do not depend on their number.
    """

    def __init__(self, factories: Sequence[Callable[[], gym.Env]], processes: int) -> None:
        """Starts the processes.

        Args:
            factories: make the environments, in the processes that step them.
            processes: how many, at most as many as environments.
        """
        parts = np.array_split(np.arange(len(factories)), processes)
        self._parts = [slice(int(part[0]), int(part[-1]) + 1) for part in parts]
        context = multiprocessing.get_context("spawn")
        self._remotes: list[Connection] = []
        self._processes = []
        self._waiting = self._closed = False
        for part in self._parts:
            here, there = context.Pipe()
            arguments = (there, here, CloudpickleWrapper(list(factories[part])))
            process = context.Process(target=_serve, args=arguments, daemon=True)
            process.start()
            there.close()
            self._remotes.append(here)
            self._processes.append(process)
        spaces = (self._call("get_attr", name)[0][0] for name in ("observation_space", "action_space"))
        super().__init__(len(factories), *spaces)

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
        for remote, part in zip(self._remotes, self._parts, strict=True):
            remote.send(("step", (actions[part],)))
        self._waiting = True

    def step_wait(self) -> Any:
        """Observations, rewards, whether episodes ended, and infos of the step that was begun."""
        found = [remote.recv() for remote in self._remotes]
        self._waiting = False
        observations, rewards, ends, infos = zip(*found, strict=True)
        return _joined(observations), np.concatenate(rewards), np.concatenate(ends), [i for part in infos for i in part]

    def close(self) -> None:
        """Ends the processes."""
        if self._closed:
            return
        self._closed = True
        if self._waiting:
            for remote in self._remotes:
                remote.recv()
        for remote in self._remotes:
            remote.send(None)
        for process in self._processes:
            process.join()

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
        return self._exchange(name, [arguments] * len(self._remotes))

    def _exchange(self, name: str, arguments: Iterable[tuple[Any, ...]]) -> list[Any]:
        """Calls a method in every process, with arguments of its own; returns what each says."""
        for remote, given in zip(self._remotes, arguments, strict=True):
            remote.send((name, given))
        return [remote.recv() for remote in self._remotes]


def _joined(parts: Iterable[Any]) -> Any:
    """Observations of all processes as one batch."""
    parts = list(parts)
    if isinstance(parts[0], dict):
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    return np.concatenate(parts)


def _serve(remote: Connection, parent: Connection, factories: CloudpickleWrapper) -> None:
    """Steps the environments of a process as it is told."""
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
