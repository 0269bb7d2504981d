"""Records episodes: ``python -m agents.collect --env ENV --policy ring --episodes N --out DIR --seed S``."""

import sys

from agents.rollouts.collect_config import CollectConfig
from labeling.runtime.cli import make_main, say_next
from labeling.runtime.help import CommandHelp


def _collect(config: CollectConfig) -> None:
    from agents.rollouts.recorder import collect_episodes

    collect_episodes(config)
    say_next("label them", "labeling.generate", config.out, "--out", "LABELS")


HELP = CommandHelp(
    groups={
        "common options": ("out", "env", "policy", "detector", "episodes", "seed"),
        "scenes and pictures": ("split", "unseen-models", "episodes-per-scene", "size"),
        "what moves": ("moving", "shifted", "moving-speed"),
        "noise of the sensors": ("sensor-noise", "pose-noise-deg", "pose-noise-m", "pose-drift-deg", "pose-drift-m"),
        "where the work is done": ("workers", "cluster", "shared"),
    },
    examples=(
        ("--out EPISODES", "an episode of the policy that comes with the project"),
        (
            "--env sbm_gym/Outdoor-v0 --policy ring --episodes 20 --workers 2 --out EPISODES",
            "as the thesis, in towns",
        ),
    ),
)
main = make_main("agents.collect", CollectConfig, _collect, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
