"""Compares policies: ``python -m agents.evaluate --policies ring random ... --split val --episodes 50 --seeds 3``."""

import sys

from agents.evaluation.evaluate_config import EvaluateConfig
from labeling.runtime.cli import make_main


def _evaluate(config: EvaluateConfig) -> None:
    from agents.evaluation.run import evaluate_policies

    evaluate_policies(config)


main = make_main("agents.evaluate", EvaluateConfig, _evaluate)

if __name__ == "__main__":
    sys.exit(main())
