"""What each half of the reward is worth: a planner that values parts of it, measured by the whole."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from experiments.cache.stages import Scale, Workplace
from experiments.cache.worlds import WORLDS

DESCRIPTION = "next_best_view told parts of the reward only, measured by the whole on validation scenes"
DETECTOR = "simulated"
SPLIT = "val"
POLICIES = (
    "next_best_view",
    "next_best_view:discovery",
    "next_best_view:diversity",
    "next_best_view:neither",
    "random",
)
"""Differences are to the first, which values both."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    episodes: int
    """Of each world, policy and seed."""


SIZES: dict[Scale, Size] = {"smoke": Size(1), "quick": Size(20), "full": Size(100)}


def run(workplace: Workplace) -> dict[str, Any]:
    """Plays what has not been played, and sums up.

    Returns:
        For each world: settings, and figures of all policies.

    Raises:
        SbmError: if a world cannot be built.
    """
    worlds = {world: _one_world(env_id, workplace) for world, env_id in WORLDS.items()}
    protocols = [world.pop("protocol") for world in worlds.values()]
    return {"compared_with": POLICIES[0], "worlds": worlds, "protocol": protocols[0]}


def _one_world(env_id: str, workplace: Workplace) -> dict[str, Any]:
    from agents.evaluation.evaluate_config import EvaluateConfig
    from agents.evaluation.run import evaluate
    from experiments.tables.policy_evaluation import played_folder

    config = EvaluateConfig(
        policies=POLICIES,
        env=env_id,
        split=SPLIT,
        episodes=SIZES[workplace.scale].episodes,
        seeds=len(workplace.seeds),
        detector=DETECTOR,
        labels=False,
        workers=workplace.workers,
        out=played_folder("reward_ablation", env_id, SPLIT, DETECTOR, None, workplace),
    )
    content = evaluate(config)
    return {name: content[name] for name in ("settings", "policies", "protocol")}


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about policies, and the pictures in it.

    Returns:
        The files written.
    """
    from experiments.pages.policies import write_page

    return write_page(results, docs)
