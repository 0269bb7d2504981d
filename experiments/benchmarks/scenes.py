"""Time and memory of opening scenes: whole episodes in new processes and resets, with the scene cache and without."""

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.benchmarks.rows import Row, log
from sbm_gym.store.cache_folder import SCENES_VARIABLE

EPISODES = 8
SEED = 100
LIMITS_S = {"sbm_gym/Indoor-v0": 3.5, "sbm_gym/Outdoor-v0": 4.0}
"""What eight episodes may cost at most, CPU seconds of the process, imports and all."""
RESET_S, FIRST_RESET_S = 0.06, 0.5
MANY_SCENES = 10
ONE_MB, WORKER_MB = 700, 250
"""Memory of one process after ``MANY_SCENES`` scenes, and of each further process in the same scenes, MB."""
STEPS_PER_S = 300.0
"""Training steps per second and core, without colours and with resets."""
NOT_KEPT = "every process builds its scenes"


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, each in new processes; times are CPU times.

    Args:
        quick: few episodes.
    """
    episodes = 2 if quick else EPISODES
    for env_id, limit_s in LIMITS_S.items():
        _alone(env_id, episodes, log_as=f"{env_id}: building what is not there yet")
        kept, built = (_alone(env_id, episodes, kept=kept) for kept in (True, False))
        what = f"{episodes} episodes of {env_id} in a fresh process, CPU"
        target = f"<= {limit_s:g} s" if episodes == EPISODES else ""
        yield Row(what, NOT_KEPT, kept["cpu_s"], built["cpu_s"], target, kept["cpu_s"] <= limit_s if target else None)
    rooms = "sbm_gym/Indoor-v0"
    count = 3 if quick else MANY_SCENES
    _alone(rooms, count, 1, scenes=True, log_as=f"{count} scenes of {rooms}")
    with _Visitor(rooms, count, 5, scenes=True) as one:
        with _Visitor(rooms, count, 5, scenes=True) as other:
            both_mb = one.memory_mb() + other.memory_mb()
        alone_mb = one.memory_mb()
        resets = one.result["resets_s"][1:]
    built = _alone(rooms, count, 5, scenes=True, kept=False)
    seconds, theirs = statistics.median(resets), statistics.median(built["resets_s"][1:])
    yield Row("reset into a scene built before, CPU", NOT_KEPT, seconds, theirs, "<= 60 ms", seconds <= RESET_S)
    holds = theirs <= FIRST_RESET_S
    yield Row("reset into a scene never seen, CPU", "limit", theirs, None, f"<= {FIRST_RESET_S:g} s", holds)
    what = f"after {count} scenes: proportional set size"
    note = f"{NOT_KEPT}: {built['pss_mb']:.0f} MB"
    yield Row(what, "limit", sum(resets), None, f"<= {ONE_MB} MB", alone_mb <= ONE_MB, note, alone_mb)
    added_mb = both_mb - alone_mb
    what = "  a further process in the same scenes adds"
    yield Row(what, "limit", sum(resets), None, f"<= {WORKER_MB} MB", added_mb <= WORKER_MB, megabytes=added_mb)
    _alone(rooms, episodes, training=True, log_as=f"scenes to train in, of {rooms}")
    kept, built = (_alone(rooms, episodes, kept=kept, training=True) for kept in (True, False))
    ours, theirs = (found["per_step_s"] for found in (kept, built))
    note = f"{1.0 / ours:.0f} steps/s"
    target, holds = f">= {STEPS_PER_S:g} steps/s per core", 1.0 / ours >= STEPS_PER_S
    yield Row("step of training without colours, resets counted, CPU", NOT_KEPT, ours, theirs, target, holds, note)


def _alone(
    env_id: str, episodes: int, steps: int | None = None, *, log_as: str = "", kept: bool = True, **how: bool
) -> dict[str, Any]:
    """What ``visit`` finds in a process of its own, which then ends."""
    with _Visitor(env_id, episodes, steps, kept=kept, **how) as visitor:
        log(f"{log_as or env_id}: {visitor.result['cpu_s']:.2f} s CPU, {visitor.result['pss_mb']:.0f} MB")
        return visitor.result


class _Visitor:
    """A process that has visited scenes and keeps them until it is left."""

    def __init__(self, env_id: str, episodes: int, steps: int | None, *, kept: bool = True, **how: bool) -> None:
        program = f"from {__name__} import visit; visit({env_id!r}, {episodes}, {steps}, **{how!r})"
        variables = dict(os.environ) if kept else {**os.environ, SCENES_VARIABLE: "off"}
        if how.get("training"):
            variables |= {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, "-c", program], env=variables, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> "_Visitor":
        assert self._process.stdout is not None
        self.result: dict[str, Any] = json.loads(self._process.stdout.readline())
        return self

    def __exit__(self, *exception: object) -> None:
        self._process.communicate()

    def memory_mb(self) -> float:
        """Its proportional set size now."""
        return proportional_mb(self._process.pid)


def visit(env_id: str, episodes: int, steps: int | None, scenes: bool = False, training: bool = False) -> None:
    """Plays episodes, prints what they cost as a line of JSON, and waits for the end of its input.

    Args:
        env_id: in which environment, made as a newcomer makes it.
        episodes: how many.
        steps: of each; None for whole ones.
        scenes: begin each in the next scene of the split, not in one drawn.
        training: as workers of ``agents.train`` have it, without colours; steps are counted after the first episode.
    """
    import gymnasium as gym

    if training:
        from agents.ppo.envs import EnvConfig, make_training_env

        env = make_training_env(EnvConfig(env_id, keys=("state",)), 0, 1)
    else:
        env = gym.make(f"sbm_gym:{env_id}")
    names = env.get_wrapper_attr("scene_names")
    env.action_space.seed(0)
    resets_s, count, after_first_s = [], 0, 0.0
    for episode in range(episodes):
        started = time.process_time()
        options = {"scene": names[episode % len(names)]} if scenes else None
        env.reset(seed=SEED if episode == 0 else None, options=options)
        resets_s.append(time.process_time() - started)
        ended, taken = False, 0
        while not ended and taken != steps:
            *_, terminated, truncated, _ = env.step(env.action_space.sample())
            ended, taken = terminated or truncated, taken + 1
        if episode:
            count, after_first_s = count + taken, after_first_s + time.process_time() - started
    found = {"cpu_s": time.process_time(), "resets_s": resets_s, "pss_mb": proportional_mb(os.getpid())}
    print(json.dumps({**found, "per_step_s": after_first_s / max(count, 1)}), flush=True)
    sys.stdin.read()


def proportional_mb(process: int) -> float:
    """Proportional set size: pages that several processes share count as the share of each. Linux only."""
    with Path(f"/proc/{process}/smaps_rollup").open(encoding="ascii") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("Pss:")) / 1024.0
