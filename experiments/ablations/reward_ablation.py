"""Ablation of the reward: planners with parts of the reward, scored by the full reward."""

from typing import Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.cache.worlds import WORLDS
from experiments.tables.policy_evaluation import evaluate_config

POLICIES = (
    "next_best_view",
    "next_best_view:discovery",
    "next_best_view:diversity",
    "next_best_view:neither",
    "random",
)
"""Differences are to the first, which values both."""


EPISODES: dict[Scale, int] = {"smoke": 1, "quick": 40, "standard": 80, "full": 140}
"""Of each world, policy and seed."""


@experiment(
    "reward_ablation",
    "next_best_view with parts of the reward only, measured by the whole in unseen scenes",
    pages=("policies.results",),
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
    from agents.evaluation.run import evaluate_policies

    episodes = EPISODES[context.scale]
    content = evaluate_policies(evaluate_config("reward_ablation", env_id, POLICIES, episodes, "simulated", context))
    return {name: content[name] for name in ("settings", "policies", "protocol")}
