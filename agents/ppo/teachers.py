"""Teachers side by side: each in a process of its own, with its share of the scenes."""

import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from pathlib import Path

import gymnasium as gym
from stable_baselines3.common.policies import ActorCriticPolicy

from agents.policies.base import Policy
from agents.policies.registry import make_policy
from agents.ppo.imitation import Demonstration, demonstrate
from agents.ppo.network.checkpoint import read_policy
from agents.ppo.workers import EnvSettings, make_shared_env
from labeling.core.errors import SbmError
from labeling.runtime.threads import threads_of_children
from labeling.runtime.worker_process import serve_parent


class Teacher:
    """A hand-written policy with an environment to show things in."""

    def __init__(self, settings: EnvSettings, policy: str, index: int, count: int) -> None:
        """Makes both; scenes are built when first needed.

        Args:
            settings: which environment.
            policy: name of the hand-written policy.
            index: which of several teachers this is.
            count: how many there are; they share the scenes.
        """
        self._env: gym.Env = make_shared_env(settings, index, count)
        self._policy: Policy = make_policy(policy, settings.env)
        self._student: tuple[Path | None, ActorCriticPolicy | None] = (None, None)

    def show(self, number: int, seed: int, keys: Sequence[str], student: Path | None) -> Demonstration:
        """One episode; see ``demonstrate``. The student is a checkpoint."""
        if student != self._student[0]:
            self._student = (student, None if student is None else read_policy(student)[0])
        return demonstrate(self._env, self._policy, number, seed, keys, self._student[1])

    def close(self) -> None:
        """Frees the env."""
        self._env.close()


class Teachers:
    """Several teachers; a single one works in this process."""

    def __init__(self, settings: EnvSettings, policy: str, count: int) -> None:
        """Hires them; arguments as of ``Teacher``."""
        self._here = Teacher(settings, policy, 0, 1) if count == 1 else None
        self._pools: list[ProcessPoolExecutor] = []
        self._exits = ExitStack()
        if count > 1:
            self._exits.enter_context(threads_of_children(1))
            context = multiprocessing.get_context("spawn")
            # One pool for each, so that every teacher keeps to its own scenes.
            self._pools = [
                ProcessPoolExecutor(1, mp_context=context, initializer=_hire, initargs=(settings, policy, index, count))
                for index in range(count)
            ]

    def show(
        self, numbers: Sequence[int], seed: int, keys: Sequence[str], student: Path | None
    ) -> Iterator[tuple[int, Demonstration]]:
        """Episodes as they are done, each with its number.

        Raises:
            SbmError: if a process has died.
        """
        if self._here is not None:
            for number in numbers:
                yield number, self._here.show(number, seed, keys, student)
            return
        waiting: dict[Future[Demonstration], int] = {
            self._pools[place % len(self._pools)].submit(_show, number, seed, keys, student): number
            for place, number in enumerate(numbers)
        }
        try:
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        except BrokenProcessPool:
            raise SbmError("a teacher's process was killed; memory may have run out (try fewer --envs)") from None

    def close(self) -> None:
        """Sends them home, whatever they are about."""
        for pool in self._pools:
            pool.shutdown(wait=False, cancel_futures=True)
        self._exits.close()
        if self._here is not None:
            self._here.close()


_hired: list[Teacher] = []
"""The teacher of a process."""


def _hire(settings: EnvSettings, policy: str, index: int, count: int) -> None:
    serve_parent()
    _hired.append(Teacher(settings, policy, index, count))


def _show(number: int, seed: int, keys: Sequence[str], student: Path | None) -> Demonstration:
    return _hired[0].show(number, seed, keys, student)
