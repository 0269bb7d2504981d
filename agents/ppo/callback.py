"""What happens beside training: progress, curves, validation, checkpoints."""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from agents.ppo.report import Pace, beside
from agents.ppo.training_state import Progress
from agents.rollouts.episode_statistics import TERM_PREFIX, means


class TrainingCallback(BaseCallback):
    """Counts steps, tells progress, validates and saves.

    Checkpoints are written between an update and the next rollout. A rollout that is stopped in the middle teaches
    nothing, and does not count.
    """

    def __init__(
        self,
        progress: Progress,
        eval_every: int,
        validate: Callable[[], dict[str, float] | None],
        save: Callable[[bool], None],
        request: threading.Event,
        say: Callable[[str], None],
        progress_bar: Callable[..., Any],
        pace: Pace,
        baselines: Mapping[str, Mapping[str, float]],
    ) -> None:
        """Starts where training stands.

        Args:
            progress: how far training has come; kept up to date.
            eval_every: steps between validations.
            validate: statistics on validation scenes, None if given up.
            save: writes the latest checkpoint, and if told so the best one.
            request: to stop at the next good moment.
            say: where progress is told.
            progress_bar: makes a progress bar (``tqdm``).
            pace: told when what begins and how long it takes.
            baselines: figures of hand-written policies in the validation episodes.
        """
        super().__init__()
        self._pace, self._beside, self._forecast_said = pace, beside(baselines), False
        self._progress, self._eval_every = progress, eval_every
        self._validate, self._save, self._request, self._say = validate, save, request, say
        self._make_bar = progress_bar
        self._episodes: list[dict[str, float]] = []
        self._in_rollout = False
        self.stopped = False
        """Whether training ended before its end."""

    def _on_training_start(self) -> None:
        total = self.locals["total_timesteps"]
        self._bar = self._make_bar(total=total, initial=self._progress.steps, desc="training")

    def _on_rollout_start(self) -> None:
        if not self._forecast_said and (forecast := self._pace.forecast(self.num_timesteps)):
            self._say(forecast)
            self._forecast_said = True
        self._after_update(last=False)
        self._episodes, self._in_rollout = [], True
        self._pace.begin_rollout(self.num_timesteps)

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        self._episodes += [info["episode_statistics"] for info in infos if "episode_statistics" in info]
        self._bar.update(self.training_env.num_envs)
        self.stopped = self._request.is_set()
        return not self.stopped

    def _on_rollout_end(self) -> None:
        self._in_rollout = False
        if not self._episodes:
            return
        statistics = means(self._episodes)
        for name, value in statistics.items():
            self.logger.record(name if name.startswith(TERM_PREFIX) else f"episode/{name}", value)
        self._progress.rollouts.append({"at": float(self.num_timesteps), **statistics})
        validated = f", validation {self._progress.validations[-1]['return']:.2f}" if self._progress.validations else ""
        self._bar.set_postfix_str(f"return {statistics['return']:.2f}{validated}{self._beside}")

    def _on_training_end(self) -> None:
        if not self._in_rollout:
            self._after_update(last=True)
        self._bar.close()

    def _after_update(self, last: bool) -> None:
        """Between an update and the next rollout: validates if it is time to, and saves."""
        progress, now = self._progress, self.num_timesteps
        since = now - int(progress.validations[-1]["at"]) if progress.validations else self._eval_every
        is_due = since >= self._eval_every or (last and since > 0)
        if progress.validations and now == progress.steps and not is_due:
            return  # just restored: all of this has been done, unless a validation was given up
        progress.steps = now
        statistics = None
        if is_due:
            began_s = time.monotonic()
            statistics = self._validate()
            self._pace.validation_s = time.monotonic() - began_s
        is_best = statistics is not None and (progress.best is None or statistics["return"] > progress.best)
        if statistics is not None:
            progress.validations.append({"at": float(now), **statistics})
            for name, value in statistics.items():
                self.logger.record(f"validation/{name}", value)
            # What is logged before the first update belongs to its step, not to that of the rollout after it.
            self.logger.dump(now)
            if is_best:
                progress.best, progress.best_steps = statistics["return"], now
            self._say(
                f"step {now}: validation return {statistics['return']:.2f}{self._beside}, "
                f"success {statistics['success']:.0%}, coverage {statistics['coverage']:.0%}, "
                f"collisions {statistics['collisions']:.1f}; best {progress.best:.2f} at step {progress.best_steps}"
            )
        self._save(is_best)
