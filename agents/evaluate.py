"""Compares policies: ``python -m agents.evaluate --policies ring random ... --split val --episodes 50 --seeds 3``."""

import sys

from agents.evaluation.evaluate_config import EvaluateConfig
from labeling.runtime.cli import run_command


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(EvaluateConfig, _evaluate, "python -m agents.evaluate", arguments)


def _evaluate(config: EvaluateConfig) -> None:
    from agents.evaluation.run import evaluate_policies

    evaluate_policies(config)


if __name__ == "__main__":
    sys.exit(main())
