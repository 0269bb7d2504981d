"""Records episodes: ``python -m agents.collect --env ENV --policy ring --episodes N --out DIR --seed S``."""

import sys

from agents.rollouts.collect_config import CollectConfig
from labeling.runtime.cli import make_main


def _collect(config: CollectConfig) -> None:
    from agents.rollouts.recorder import collect_episodes

    collect_episodes(config)


main = make_main("agents.collect", CollectConfig, _collect)

if __name__ == "__main__":
    sys.exit(main())
