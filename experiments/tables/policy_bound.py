"""How much better than the policies the best of many ways from a start is: a bound on what any policy can gain.

The best of many draws is luck as well as room for improvement, so draws of a policy are only to be compared with as
many draws of another.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from agents.policies.ppo import Ppo
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.cache.worlds import WORLDS
from experiments.tables.policy_evaluation import LABEL_VIEWS, SPLIT, evaluate_config
from labeling.runtime.code_digest import code_digest

WORLD, DETECTOR = "rooms", "simulated:compact"
"""The simulated detector that is fitted to ``compact``: so many ways with the detector itself would take days."""


class SampledEvidence(Ppo):
    """``ppo_evidence``, whose actions are drawn by their probabilities as in training."""

    def __init__(self) -> None:
        """Reads the weights that come with the project."""
        from agents.policies.registry import checkpoint_of

        checkpoint = checkpoint_of("ppo_evidence", WORLDS[WORLD])
        assert checkpoint is not None, "it comes with the project"
        super().__init__(checkpoint, sampled=True)


SAMPLED = f"{__name__}:{SampledEvidence.__name__}"
POLICIES = ("ring", "next_best_view", SAMPLED)
"""The first is what the others are compared with."""
SIZES: dict[Scale, tuple[int, int]] = {"smoke": (1, 2), "quick": (10, 32), "standard": (20, 64), "full": (40, 200)}
"""Starts, in as many homes, and draws from each."""


@experiment(
    "policy_bound",
    "rooms: the best of many ways from one start, beside their mean and the ring: what is left for any policy to gain",
    pages=("policies.results",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Plays every start many times, and labels what each way has seen.

    Seeds are not counted: every start is drawn from many times.

    Returns:
        The starts, and for each policy and number of views the right labels of its mean way and of its best one.

    Raises:
        SbmError: if the world cannot be built.
    """
    from agents.evaluation.label_quality import episode_figures
    from agents.evaluation.results import policy_key
    from agents.evaluation.run import Evaluator, evaluate_policies
    from agents.rollouts.run_episode import episode_spec

    starts, draws = SIZES[context.scale]
    # The name of a class says nothing of the weights that it reads.
    sampled = [policy_key("ppo_evidence", WORLDS[WORLD]), code_digest(SampledEvidence)] if SAMPLED in POLICIES else []
    own = replace(context, seeds=(0,))  # draws take the place of seeds
    config = evaluate_config("policy_bound", WORLDS[WORLD], POLICIES, starts, DETECTOR, own, labels=True, more=sampled)
    config = replace(config, draws=draws)
    evaluate_policies(config)
    evaluator = Evaluator(config)
    specs = [episode_spec(evaluator.scenes, 0, episode) for episode in range(starts)]
    plays = {
        policy: [[episode_figures(play["label_quality"]) for play in evaluator.results(spec, policy)] for spec in specs]
        for policy in POLICIES
    }
    return {
        "env": WORLDS[WORLD],
        "detector": DETECTOR,
        "split": SPLIT,
        "starts": [spec.scene for spec in specs],
        "draws": draws,
        "policies": {policy.rpartition(":")[2]: _figures(found) for policy, found in plays.items()},
    }


def _figures(plays: list[list[dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Right labels by number of views: of the mean way and of the best one, over starts.

    Args:
        plays: ``episode_figures`` of every draw from every start.
    """
    found = {}
    for views in map(str, LABEL_VIEWS):
        right = [[play[views]["right"] for play in draws] for draws in plays]
        starts = [{"mean": float(np.mean(draws)), "best": float(np.max(draws))} for draws in right]
        means = {name: float(np.mean([start[name] for start in starts])) for name in ("mean", "best")}
        found[views] = {**means, "per_start": starts}
    return found
