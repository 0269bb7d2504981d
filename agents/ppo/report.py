"""What a run says of itself: what it will take, how fast it goes, what has come of it, and how to use that."""

import math
import multiprocessing
import os
import shlex
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.statistics import MIN_SCENES, MIN_STARTS, shown_sign
from agents.network.files import BEST, FIRST, TENSORBOARD_FOLDER, UNSEEN_FOLDER
from agents.ppo.baselines import BASELINES
from agents.ppo.run_settings import RunSettings
from agents.ppo.training_state import Progress

COMPARED_SCENES = 20
GB = 2**30


def plan(settings: RunSettings, steps_done: int, scenes: int, compared: int) -> str:
    """What a run will do, before it starts.

    Args:
        settings: of the run.
        steps_done: where it goes on.
        scenes: how many it is validated in.
        compared: starts of the table at the end.
    """
    options, hyperparameters = settings.options, settings.hyperparameters
    rollout = hyperparameters.n_envs * hyperparameters.n_steps
    steps = math.ceil((hyperparameters.n_timesteps - steps_done) / rollout) * rollout
    validations = math.ceil(steps / max(options.eval_every, rollout)) + (steps_done == 0)
    lines = [
        f"run:    {settings.folder}",
        f"curves: tensorboard --logdir {settings.folder / TENSORBOARD_FOLDER}",
        f"plan:   {steps:,} steps in rollouts of {rollout:,}; about {validations} validations of "
        f"{options.eval_episodes} starts{f' in {scenes} scenes' if scenes else ''}",
    ]
    if scenes:
        lines[-1] += f", {options.eval_episodes * len(BASELINES)} episodes of {', '.join(BASELINES)} before"
        lines[-1] += f", {compared * (len(BASELINES) + 2)} unseen ones after" if compared else ""
    return "\n".join(lines)


class Pace:
    """How long training and validation take, from what they have taken."""

    def __init__(self, total: int, eval_every: int) -> None:
        """Knows nothing yet.

        Args:
            total: steps of the run.
            eval_every: steps between validations.
        """
        self._total, self._eval_every = total, eval_every
        self._began: tuple[float, int] | None = None
        self.validation_s = 0.0
        """How long the last validation took."""

    def begin_rollout(self, steps: int) -> None:
        """Notes where a rollout begins."""
        self._began = (time.monotonic(), steps)

    def forecast(self, steps: int) -> str | None:
        """Steps a second of the rollout and update before, time to go, and memory; None before the first."""
        if self._began is None or steps == self._began[1]:
            return None
        rate = (steps - self._began[1]) / (time.monotonic() - self._began[0])
        left = self._total - steps
        to_go_s = left / rate + math.ceil(left / self._eval_every) * self.validation_s
        memory = resident_bytes()
        used = "" if memory is None else f"; {memory / GB:.1f} GB of memory"
        return f"{rate:,.0f} steps/s: about {duration(to_go_s)} to go{used}"


def duration(seconds: float) -> str:
    """In words: ``42 s``, ``12 min``, ``3.5 h``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.1f} h"


def resident_bytes() -> int | None:
    """Memory of this process and those it has started; None where the system does not tell it."""
    pids = [os.getpid(), *(process.pid for process in multiprocessing.active_children())]
    files = [Path(f"/proc/{pid}/statm") for pid in pids]
    if not files[0].is_file():
        return None
    return sum(int(file.read_text().split()[1]) for file in files if file.is_file()) * os.sysconf("SC_PAGE_SIZE")


def beside(baselines: Mapping[str, Mapping[str, float]]) -> str:
    """Returns of hand-written policies, for the end of a line."""
    found = ", ".join(f"{name} {figures['return']:.2f}" for name, figures in baselines.items())
    return f" ({found})" if found else ""


def comparison(settings: RunSettings, starts: int, workers: int) -> EvaluateConfig:
    """The evaluation that ends a run: in scenes that it was neither trained in nor chosen by.

    Args:
        settings: of the run.
        starts: how many.
        workers: processes side by side.
    """
    folder = settings.folder
    return EvaluateConfig(
        policies=(f"ppo:{folder / BEST}", f"ppo:{folder / FIRST}", *BASELINES),
        env=settings.options.env,
        scenes=COMPARED_SCENES,
        episodes=starts,
        detector=settings.options.detector,
        # Parts of the thesis' reward are for training alone: all else has the whole of it.
        reward="evidence" if settings.options.reward == "evidence" else "views",
        workers=workers,
        out=folder / UNSEEN_FOLDER,
    )


def table(content: Mapping[str, Any], progress: Progress) -> str:
    """What the policy earns where it has never been, before training and after, beside hand-written ones.

    Args:
        content: of the ``evaluation.json`` of ``comparison``.
        progress: of the run.
    """
    names = [f"trained ({progress.best_steps:,} steps)", "untrained", *BASELINES]
    figures = [found["figures"]["return"] for found in content["policies"].values()]
    width = max(map(len, names))
    starts, scenes = content["settings"]["episodes"], len(content["settings"]["scenes"])
    paid = " of evidence" if content["settings"].get("reward") == "evidence" else ""
    lines = [
        f"return{paid} from {starts} unseen starts in {scenes} scenes, with 95 % intervals over both:",
        f"  {'':{width}}  {'return':>12}  trained policy minus this one",
    ]
    for name, figure in zip(names, figures, strict=True):
        mean = f"{figure['mean']:.2f}"
        if figure["low"] is not None:
            mean += f" ±{(figure['high'] - figure['low']) / 2:.2f}"
        lines.append(f"  {name:{width}}  {mean:>12}  {_gain(figure['difference'])}".rstrip())
    resolved = [one["difference"]["resolves"] or 0.0 for one in figures[1:]]
    if max(resolved) > 0.0:
        lines.append(f"{starts} starts resolve differences of {max(resolved):.2f}; * marks what is shown.")
    if starts < MIN_STARTS or scenes < MIN_SCENES:
        lines.append(f"Nothing is shown by fewer than {MIN_STARTS} starts in {MIN_SCENES} scenes.")
    return "\n".join(lines)


def _gain(difference: Mapping[str, Any] | None) -> str:
    """The trained policy's lead over another: the difference to it, turned round."""
    if difference is None:
        return ""
    gain = f"{0.0 - difference['mean']:+.2f}"
    if difference["low"] is not None:
        gain += f" [{0.0 - difference['high']:+.2f}, {0.0 - difference['low']:+.2f}]"
    return f"{gain}{' *' if shown_sign(difference) else ''}"


def commands(settings: RunSettings) -> str:
    """The commands that use the policy: record with it, compare it, film it, train on."""
    options, folder = settings.options, settings.folder
    where = f"--env {shlex.quote(options.env)} --detector {shlex.quote(options.detector)}"
    policy, quoted = shlex.quote(f"ppo:{folder / BEST}"), shlex.quote(str(folder))
    episodes, evaluation, pictures = (
        shlex.quote(str(folder / name)) for name in ("episodes", "evaluation", "pictures")
    )
    paid = "" if options.reward != "evidence" else " --reward evidence"
    return "\n".join(
        [
            "use it:",
            f"  python -m agents.collect {where} --policy {policy} --out {episodes}",
            f"  python -m agents.evaluate {where}{paid} --policies ring next_best_view {policy} --episodes 400 "
            f"--scenes 40 --out {evaluation}",
            f"  python -m experiments.policy_pictures {where} --policies ring {policy} --out {pictures} "
            f"--results {pictures}",
            f"  python -m agents.train --resume {quoted} --steps {2 * settings.hyperparameters.n_timesteps}",
        ]
    )
