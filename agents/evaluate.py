"""Compares policies: ``python -m agents.evaluate --policies ring random ... --split val --episodes 50 --seeds 3``."""

import sys

from agents.evaluation.evaluate_config import EvaluateConfig
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


def _evaluate(config: EvaluateConfig) -> None:
    from agents.evaluation.run import evaluate_policies

    evaluate_policies(config)


HELP = CommandHelp(
    groups={
        "common options": ("policies", "env", "detector", "episodes", "seeds", "out"),
        "scenes and draws": ("split", "scenes", "draws"),
        "labels": ("labels", "label-views", "size", "pictures"),
        "where the work is done": ("workers", "cluster", "shared"),
    },
    examples=(
        ("--policies ring random --episodes 50", "returns of two policies from the same starts"),
        ("--policies ppo ring --labels --out COMPARED", "and the labels that they bring home"),
    ),
)
main = make_main("agents.evaluate", EvaluateConfig, _evaluate, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
