"""Trains a policy: ``python -m agents.train --env ENV --out RUN --seed S``."""

import functools
import sys

from agents.ppo.config import PpoConfig
from labeling.runtime.cli import run_command


def run(config: PpoConfig) -> None:
    """Trains, telling on the terminal how it goes.

    Raises:
        SbmError: if a setting makes no sense, or the folder holds another run.
        KeyboardInterrupt: if stopped by Ctrl-C, after everything has been saved.
    """
    from tqdm import tqdm

    from agents.ppo.training import train_ppo

    train_ppo(config, tqdm.write, functools.partial(tqdm, unit="step", file=sys.stderr, dynamic_ncols=True))


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(PpoConfig, run, "python -m agents.train", arguments)


if __name__ == "__main__":
    sys.exit(main())
