"""What happens beside training: progress, curves, validation, checkpoints."""

from collections.abc import Callable
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from agents.ppo.episode_figures import TERM, means
from agents.ppo.state import Progress
from labeling.runtime.interrupts import StopRequest

GROUP, VALIDATION_GROUP = "episode", "validation"


class RunCallback(BaseCallback):
    """Counts, tells, validates and saves.

    Checkpoints are written between an update and the next rollout. A rollout that is stopped in the middle teaches
    nothing, and does not count.
    """

    def __init__(
        self,
        progress: Progress,
        eval_every: int,
        validate: Callable[[], dict[str, float] | None],
        save: Callable[[bool], None],
        request: StopRequest,
        say: Callable[[str], None],
        bar: Callable[..., Any],
    ) -> None:
        """Starts where training stands.

        Args:
            progress: how far training has come; kept up to date.
            eval_every: steps between validations.
            validate: figures on validation scenes, None if given up.
            save: writes the latest checkpoint, and if told so the best one.
            request: to stop at the next good moment.
            say: where progress is told.
            bar: makes a progress bar (``tqdm``).
        """
        super().__init__()
        self._progress, self._eval_every = progress, eval_every
        self._validate, self._save, self._request, self._say, self._make_bar = validate, save, request, say, bar
        self._bar: Any = None
        self._episodes: list[dict[str, float]] = []
        self._rolling = False
        self.stopped = False
        """Whether training ended before its end."""

    def _on_training_start(self) -> None:
        total = self.locals["total_timesteps"]
        self._bar = self._make_bar(total=total, initial=self._progress.steps, desc="training")

    def _on_rollout_start(self) -> None:
        self._settle(last=False)
        self._episodes, self._rolling = [], True

    def _on_step(self) -> bool:
        self._episodes += [info["figures"] for info in self.locals["infos"] if "figures" in info]
        self._bar.update(self.training_env.num_envs)
        self.stopped = self._request.stop
        return not self.stopped

    def _on_rollout_end(self) -> None:
        self._rolling = False
        if not self._episodes:
            return
        figures = means(self._episodes)
        self._draw(GROUP, figures)
        self._progress.rollouts.append({"at": float(self.num_timesteps), **figures})
        self._bar.set_postfix_str(f"return {figures['return']:.2f}, success {figures['success']:.0%}")

    def _on_training_end(self) -> None:
        if not self._rolling:
            self._settle(last=True)
        self._bar.close()

    def _settle(self, last: bool) -> None:
        """Between an update and the next rollout: validates if it is time to, and saves."""
        progress, now = self._progress, self.num_timesteps
        if progress.validations and now == progress.steps:
            return  # just restored: all of this has been done
        progress.steps = now
        since = now - int(progress.validations[-1]["at"]) if progress.validations else self._eval_every
        figures = self._validate() if since >= self._eval_every or (last and since) else None
        better = figures is not None and (progress.best is None or figures["return"] > progress.best)
        if figures is not None:
            progress.validations.append({"at": float(now), **figures})
            self._draw(VALIDATION_GROUP, figures)
            # What is drawn before the first update belongs to its step, not to that of the rollout after it.
            self.logger.dump(now)
            if better:
                progress.best, progress.best_steps = figures["return"], now
            self._say(self._line(figures))
        self._save(better)

    def _draw(self, group: str, figures: dict[str, float]) -> None:
        for name, value in figures.items():
            self.logger.record(name if name.startswith(TERM) and group == GROUP else f"{group}/{name}", value)

    def _line(self, figures: dict[str, float]) -> str:
        progress = self._progress
        return (
            f"step {progress.steps}: validation return {figures['return']:.2f}, success {figures['success']:.0%}, "
            f"coverage {figures['coverage']:.0%}, collisions {figures['collisions']:.1f}; "
            f"best {progress.best:.2f} at step {progress.best_steps}"
        )
