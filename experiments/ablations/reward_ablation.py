"""What each half of the reward is worth: a planner that values parts of it, measured by the whole."""

from dataclasses import dataclass
from typing import Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.cache.worlds import WORLDS

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


@experiment(
    "reward_ablation",
    "next_best_view with parts of the reward only, measured by the whole on validation scenes",
    pages=("policies",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Plays what has not been played, and sums up.

    Returns:
        For each world: settings, and figures of all policies.

    Raises:
        SbmError: if a world cannot be built.
    """
    worlds = {world: _one_world(env_id, context) for world, env_id in WORLDS.items()}
    protocols = [world.pop("protocol") for world in worlds.values()]
    return {"compared_with": POLICIES[0], "worlds": worlds, "protocol": protocols[0]}


def _one_world(env_id: str, context: RunContext) -> dict[str, Any]:
    from agents.evaluation.evaluate_config import EvaluateConfig
    from agents.evaluation.run import evaluate_policies
    from experiments.tables.policy_evaluation import episodes_folder

    config = EvaluateConfig(
        policies=POLICIES,
        env=env_id,
        split=SPLIT,
        episodes=SIZES[context.scale].episodes,
        seeds=len(context.seeds),
        detector=DETECTOR,
        labels=False,
        workers=context.workers,
        out=episodes_folder("reward_ablation", env_id, SPLIT, DETECTOR, None, context),
    )
    content = evaluate_policies(config)
    return {name: content[name] for name in ("settings", "policies", "protocol")}
