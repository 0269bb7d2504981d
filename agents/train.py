"""Trains a policy: ``python -m agents.train --env ENV --out RUN --seed S``."""

import functools
import sys

from agents.ppo.config import PpoConfig
from labeling.runtime.cli import make_main


def run(config: PpoConfig) -> None:
    """Trains, telling on the terminal how it goes.

    Raises:
        SbmError: if a setting makes no sense, or the folder holds another run.
        KeyboardInterrupt: if stopped by Ctrl-C, after everything has been saved; SystemExit by other signals.
    """
    from tqdm import tqdm

    from agents.ppo.training import train_ppo

    train_ppo(config, tqdm.write, functools.partial(tqdm, unit="step", file=sys.stderr, dynamic_ncols=True))


main = make_main("agents.train", PpoConfig, run)

if __name__ == "__main__":
    sys.exit(main())
