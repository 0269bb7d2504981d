"""Trains a policy: ``python -m agents.train --env ENV --out RUN --seed S``."""

import functools
import sys

from agents.ppo.config import PpoConfig
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


def run(config: PpoConfig) -> None:
    """Trains, telling on the terminal how it goes.

    Raises:
        SbmError: if a setting makes no sense, or the folder holds another run.
        KeyboardInterrupt: if stopped by Ctrl-C, after everything has been saved; SystemExit by other signals.
    """
    from tqdm import tqdm

    from agents.ppo.training import train_ppo

    train_ppo(config, tqdm.write, functools.partial(tqdm, unit="step", file=sys.stderr, dynamic_ncols=True))


HELP = CommandHelp(
    groups={
        "common options": ("out", "env", "steps", "seed", "reward", "detector", "hyperparams", "resume"),
        "scenes": ("scenes", "validation-scenes", "atlas"),
        "validation": ("eval-every", "eval-episodes", "compare-episodes"),
        "where the work is done": ("envs", "processes", "device", "cluster", "shared"),
        "code of others": ("allow-code",),
    },
    examples=(
        ("--out RUN", "with the hyperparameters that come with the project"),
        ("--env sbm_gym/Outdoor-v0 --steps 1000000 --out RUN", "longer, in towns"),
        ("--resume RUN --steps 2000000", "go on with a run"),
    ),
)
main = make_main("agents.train", PpoConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
