"""The main job, end to end: ``python -m experiments.demo`` moves, labels, and compares labels with the detector."""

import sys
import time
from dataclasses import dataclass
from pathlib import Path

from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class DemoConfig:
    """Collects episodes with a trained policy, labels them, and evaluates the labels against the detector.

    Started again, it goes on with what is missing.
    """

    out: Path = Path("out/demo")
    """Folder for the episodes (OUT/episodes) and the labels (OUT/labels)."""
    episodes: int = 4
    """Episodes of 25 views each."""
    policy: str = "ppo"
    """Who moves: "ppo" (trained, ships with the project), "ring" (the thesis'), or any that agents.collect knows."""
    detector: str = "compact"
    """Guides the agent, and is to be improved on: "compact", "simulated", or another that agents.collect knows."""
    seed: int = 0
    """Decides scenes, starting places and all noise."""


def run(config: DemoConfig) -> None:
    """Runs the three stages and says where everything is.

    Raises:
        SbmError: if a stage cannot run, such as when the furniture libraries are missing.
    """
    from agents.rollouts.collect_config import CollectConfig
    from agents.rollouts.recorder import collect_episodes
    from labeling import evaluate, generate

    dataset, labels = config.out / "episodes", config.out / "labels"
    started_s = time.monotonic()
    _say(f"1/3 moving: {config.episodes} episodes of the policy {config.policy} with the detector {config.detector}")
    collect_episodes(
        CollectConfig(
            out=dataset, policy=config.policy, detector=config.detector, episodes=config.episodes, seed=config.seed
        )
    )
    _say("2/3 labelling: confident detections to 3-D and back into every view")
    generate.run(generate.GenerateConfig(dataset=dataset, out=labels))
    _say("3/3 checking: detector and pseudo-labels against ground truth, on the same views")
    evaluation = evaluate.run(evaluate.EvaluateConfig(labels=labels))
    detector, pseudo_labels = evaluation.metrics["detector"], evaluation.metrics["pseudo_labels"]
    _say(f"done in {time.monotonic() - started_s:.0f} s")
    print(
        f"mask AP50: detector {detector['mask_ap50']:.3f}, pseudo-labels {pseudo_labels['mask_ap50']:.3f}\n"
        f"Open {labels / evaluate.REPORT_FILE} in a browser to see every step of the way."
    )


def _say(heading: str) -> None:
    print(f"\n== {heading}", flush=True)


HELP = CommandHelp(
    examples=(
        ("", "four episodes, labelled and evaluated: about two minutes"),
        ("--episodes 20 --policy ring --out out/ring", "more of them, by the thesis' policy"),
    ),
)
main = make_main("experiments.demo", DemoConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
