"""Records episodes: ``python -m agents.collect --env ENV --policy ring --episodes N --out DIR --seed S``."""

import sys

from agents.rollouts.collect_config import CollectConfig
from labeling.runtime.cli import run_command


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(CollectConfig, _collect, "python -m agents.collect", arguments)


def _collect(config: CollectConfig) -> None:
    from agents.rollouts.recorder import collect_episodes

    collect_episodes(config)


if __name__ == "__main__":
    sys.exit(main())
