"""What a detector learns from the views of each policy: as many episodes of each, the same training for all.

It learns from their labels, and besides from their ground truth, which tells what is the views' doing from what is the
labels'.
"""

from typing import Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES, WORLDS
from experiments.tables.fine_tuning import count_errors
from experiments.tables.policy_evaluation import available_policies, training_of
from experiments.tables.training_sets import TRUTH, Subset, TrainingSets

POLICIES = ("ring", "next_best_view", "ppo", "ppo_evidence")
"""Differences are to the first. The last two come with the project, where they do."""
TEACHERS = {"labels": "shared", "truth": TRUTH}
"""What is learnt from, as training sets name it; labels: what any episode of a scene has found is labelled in all."""


SUBSETS: tuple[Subset, ...] = ("learn", "choose")


ABOUT = "compact fine-tuned on the labels of each policy's views of training {}, tested on unseen endless ones"


@experiment("policies", ABOUT.format("homes"), pages=("policies.results",))
def run(context: RunContext) -> dict[str, Any]:
    """Records, labels, trains and scores in rooms; see ``teach``."""
    return teach("rooms", context)


@experiment("policies_streets", ABOUT.format("towns"), pages=("policies.results",))
def run_streets(context: RunContext) -> dict[str, Any]:
    """The same in streets."""
    return teach("streets", context)


def teach(world: str, context: RunContext) -> dict[str, Any]:
    """Settings are those of ``fine_tuning``.

    Args:
        world: one of ``WORLDS``.
        context: seeds, workers and cache.

    Returns:
        For the world: the episodes, how good the labels are, the detector before, and every run by policy and seed.
    """
    return {
        "compared_with": POLICIES[0],
        "detector": DETECTOR,
        "settings": SIZES[context.scale].settings(world),
        "worlds": {world: _one_world(world, context)},
    }


def _one_world(world: str, context: RunContext) -> dict[str, Any]:
    from experiments.cache.detector_stages import score_labels

    policies, left_out = available_policies(WORLDS[world], POLICIES)
    sets, views = TrainingSets(world, context), {policy: TrainingSets(world, context, policy) for policy in policies}
    pools = {f"{policy}_{subset}": views[policy].pool_record(subset) for policy in policies for subset in SUBSETS}
    labels, runs = [], []
    for policy in policies:
        for name, teacher in TEACHERS.items():
            for seed in context.seeds:
                job = views[policy].train_job(teacher, seed)
                runs.append(({"policy": policy, "teacher": name, "seed": seed}, job))
                if name == "labels":
                    scores = score_labels(views[policy].labels("learn", teacher, seed))
                    errors = count_errors(job.learn, views[policy].pictures("learn"))
                    labels.append({"policy": policy, "seed": seed, **scores, "errors": errors})
    # The scenes to be tested in as each policy sees them: who learns from one's views is tested on all others' as well.
    seen = {views_of(policy): views[policy].pictures("dev") for policy in policies}
    scores = sets.train_and_score(runs, "dev", seen)
    for run in (scores["before"], *scores["runs"]):
        for name in seen:
            run[name].pop("resampled", None)  # large, and intervals are told of the dev scenes alone
    return {
        "pools": {"dev": sets.pool_record("dev"), **pools},
        "left_out": left_out,
        "trained": training_of(policies, WORLDS[world]),
        "labels": labels,
        **scores,
    }


def views_of(policy: str) -> str:
    """What the record calls the views that a policy has of the scenes to be tested in."""
    return f"views of {policy}"
