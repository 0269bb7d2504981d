"""Hand-written policies in the validation episodes of a run: what its curve is to be compared with."""

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from agents.network.files import HISTORY_FILE
from agents.policies.registry import make_policy
from agents.ppo.envs import EnvConfig, make_env
from agents.ppo.validation import play
from agents.rollouts.episode_statistics import means
from labeling.core.errors import SbmError
from labeling.formats.checked_json import read_json
from labeling.runtime.process_pool import PerProcess, map_jobs

BASELINES = ("random", "ring", "next_best_view")

Job = tuple[str, tuple[tuple[int, str], ...]]
"""A policy, and numbers and scenes of episodes that it plays."""


def play_baselines(
    config: EnvConfig,
    episodes: int,
    scenes: Sequence[str],
    processes: int,
    progress_bar: Callable[..., Any],
    given_up: Callable[[], bool],
) -> dict[str, dict[str, float]] | None:
    """Statistics of hand-written policies on the very episodes that a policy in training is validated on.

    Args:
        config: the environment of validation.
        episodes: of a validation.
        scenes: where they are, spread evenly over these.
        processes: side by side; their number changes nothing but the time.
        progress_bar: makes a progress bar (``tqdm``).
        given_up: asked now and then whether there is no more time.

    Returns:
        Means over the episodes by policy and name, None if given up.
    """
    plain = replace(config, wrapper=None, keys=("state",))
    starts = [(number, scenes[number * len(scenes) // episodes]) for number in range(episodes)]
    by_scene = [tuple(start for start in starts if start[1] == scene) for scene in dict.fromkeys(s for _, s in starts)]
    jobs: list[Job] = [(name, part) for part in by_scene for name in BASELINES]
    found: dict[str, list[dict[str, float]]] = {name: [] for name in BASELINES}
    bar = progress_bar(total=episodes * len(BASELINES), unit="episode", desc="hand-written policies")
    with closing(bar), closing(map_jobs(PerProcess(partial(_player, plain)), jobs, processes, ordered=True)) as results:
        for (name, _), some in zip(jobs, results, strict=True):
            found[name] += some
            bar.update(len(some))
            if given_up():
                return None
    return {name: means(some) for name, some in found.items()}


def _player(config: EnvConfig) -> Callable[[Job], list[dict[str, float]]]:
    env = make_env(config)

    def play_all(job: Job) -> list[dict[str, float]]:
        name, starts = job
        policy = make_policy(name, config.env)
        return [play(policy, env, number, scene) for number, scene in starts]

    return play_all


def kept_baselines(run: Path) -> dict[str, dict[str, float]] | None:
    """What the history of a run says of them; None if they have not been played.

    Raises:
        SbmError: if the history is damaged.
    """
    path = run / HISTORY_FILE
    if not path.is_file():
        return None
    found = read_json(path).mapping().get("baselines")
    parts = found.values() if isinstance(found, dict) else [found]
    if found is not None and not all(isinstance(one, dict) and _is_number(one.get("return")) for one in parts):
        raise SbmError(f"{path}: is damaged: baselines holds no figures by policy; delete it to play them again")
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)
