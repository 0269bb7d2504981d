"""What a detector learns from the views of each policy: as many episodes of each, the same training for all.

It learns from their labels, and besides from their ground truth, which tells what is the views' doing from what is the
labels'. Every seed has other episodes, and a policy that was trained from several seeds another of its trainings, so
that the spread over seeds is that of everything that differs when somebody does the same again.
"""

from typing import Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.cache.worlds import DETECTOR, SIZES, WORLDS
from experiments.tables.label_errors import count_errors
from experiments.tables.policy_evaluation import available_policies, training_of
from experiments.tables.training_sets import TRUTH, TrainingSets

POLICIES = ("ring", "next_best_view", "ppo", "ppo_evidence")
"""Differences are to the first. The last two come with the project, where they do."""
TEACHERS = {"labels": "shared", "truth": TRUTH}
"""What is learnt from, as training sets name it; labels: what any episode of a scene has found is labelled in all."""


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

    env_id = WORLDS[world]
    policies, left_out = available_policies(env_id, POLICIES)
    moved = {(policy, seed): training_from_seed(policy, seed, env_id) for policy in policies for seed in context.seeds}
    views = {(policy, seed): TrainingSets(world, context, by, recording=seed) for (policy, seed), by in moved.items()}
    sets, pools, labels, runs = TrainingSets(world, context), {}, [], []
    for (policy, seed), seen_by in views.items():
        about = {"policy": policy, "seed": seed, "moved_by": moved[policy, seed]}
        pools[f"{policy}_{seed}_learn"] = seen_by.pool_record("learn")
        for name, teacher in TEACHERS.items():
            job = seen_by.train_job(teacher, seed)
            runs.append(({**about, "teacher": name}, job))
            if name == "labels":
                scores = score_labels(seen_by.labels("learn", teacher, seed))
                errors = count_errors(job.learn, seen_by.pictures("learn"))
                labels.append({**about, **scores, "errors": errors})
    # The scenes to be tested in as each policy sees them: who learns from one's views is tested on all others' as well.
    seen = {views_of(policy): TrainingSets(world, context, policy).pictures("dev") for policy in policies}
    scores = sets.train_and_score(runs, "dev", seen)
    for run in (scores["before"], *scores["runs"]):
        for name in seen:
            run[name].pop("resampled", None)  # large, and intervals are told of the dev scenes alone
    return {
        "pools": {"dev": sets.pool_record("dev"), **pools},
        "left_out": left_out,
        "trained": training_of(tuple(dict.fromkeys(moved.values())), env_id),
        "labels": labels,
        **scores,
    }


def training_from_seed(policy: str, seed: int, env_id: str) -> str:
    """Which training of a policy moves: that from the same seed, where the project has it, else the policy itself."""
    from agents.policies.registry import checkpoint_of
    from labeling.core.errors import UsageError

    named = f"{policy}_seed_{seed}"
    try:
        return named if checkpoint_of(named, env_id) else policy
    except UsageError:  # there is no such training
        return policy


def views_of(policy: str) -> str:
    """What the record calls the views that a policy has of the scenes to be tested in."""
    return f"views of {policy}"
