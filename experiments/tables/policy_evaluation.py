"""Policies against each other, with a real detector in the loop: what they earn and bring home, in each world."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale, digest
from experiments.cache.worlds import DETECTOR, WORLDS
from labeling.runtime.code_digest import code_digest
from sbm_gym.worlds.splits import WIDE

if TYPE_CHECKING:
    from agents.evaluation.evaluate_config import EvaluateConfig

SPLIT, SCENES = "endless", 40
"""Scenes that no policy was trained in or chosen by, as many homes and as many towns."""
TRAINED = ("ppo", "ppo_evidence")
"""Those that come with the project, where there are any."""
POLICIES = ("ring", "next_best_view", *(f"{name}{seed}" for name in TRAINED for seed in ("", "_seed_1", "_seed_2")))
"""Differences are to the first. Each training has three seeds."""
WIDE_POLICIES = tuple(policy for policy in POLICIES if "evidence" not in policy)
UNMAPPED = (
    *("ring", "next_best_view", "next_best_view:unmapped", "ppo"),
    *(f"ppo_unmapped{seed}" for seed in ("", "_seed_1", "_seed_2")),
)
"""Those that are given no map, beside those that are."""
LABEL_VIEWS = (12, 25)
"""Of so many of the first views."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    rooms: tuple[int, int]
    """Episodes of each policy and seed, and of how many of them, the first, labels are made."""
    streets: tuple[int, int]
    """The same in streets, whose pictures are three times as large."""
    picture_px: int | None = None
    """Height of the pictures that labels are made on; None is the world's own."""


SIZES: dict[Scale, Size] = {
    "smoke": Size((1, 1), (1, 1), 64),
    "quick": Size((40, 40), (40, 20)),
    "standard": Size((140, 40), (70, 40)),
    "full": Size((140, 140), (140, 140)),
}


ABOUT = "what policies earn, and how good the labels of their views are, in unseen {} with compact"
WITHOUT_A_MAP = "the same of policies that are given no map of the {}, beside those that are"


@experiment("policy_evaluation", ABOUT.format("homes"), pages=("policies.results",))
def run(context: RunContext) -> dict[str, Any]:
    """Plays what has not been played in rooms, and sums up; see ``evaluate_world``."""
    return evaluate_world("rooms", context, POLICIES)


@experiment("policy_evaluation_streets", ABOUT.format("towns"), pages=("policies.results",))
def run_streets(context: RunContext) -> dict[str, Any]:
    """The same in streets."""
    return evaluate_world("streets", context, POLICIES)


@experiment("policy_evaluation_unmapped", WITHOUT_A_MAP.format("homes"), pages=("policies.results",))
def run_unmapped(context: RunContext) -> dict[str, Any]:
    """The same of policies that are given no map of the homes, beside those that are."""
    return evaluate_world("rooms", context, UNMAPPED, "policy_evaluation_unmapped")


@experiment("policy_evaluation_unmapped_streets", WITHOUT_A_MAP.format("towns"), pages=("policies.results",))
def run_unmapped_streets(context: RunContext) -> dict[str, Any]:
    """The same in streets."""
    return evaluate_world("streets", context, UNMAPPED, "policy_evaluation_unmapped")


@experiment(
    "policy_evaluation_wide",
    "what policies earn in the homes of the split wide with compact",
    pages=("policies.results",),
)
def run_wide(context: RunContext) -> dict[str, Any]:
    """The same in the homes that detectors are reported on, without labels: to be looked at once for each release."""
    from agents.evaluation.run import evaluate_policies

    env_id, episodes = WORLDS["rooms"], SIZES[context.scale].rooms[0]
    policies, left_out = available_policies(env_id, WIDE_POLICIES)
    config = evaluate_config("policy_evaluation_wide", env_id, policies, episodes, DETECTOR, context)
    content = evaluate_policies(replace(config, split=WIDE))
    figures = _figures(content, env_id, policies, left_out)
    return {"compared_with": POLICIES[0], "worlds": {"rooms": figures}, "protocol": content["protocol"]}


def evaluate_world(
    world: str, context: RunContext, policies: Sequence[str], name: str = "policy_evaluation"
) -> dict[str, Any]:
    """Plays what has not been played, and sums up.

    Args:
        world: one of ``WORLDS``.
        context: seeds, workers and cache.
        policies: who is compared, with the first.
        name: of the folders in the cache.

    Returns:
        The policy that others are compared with; for the world, settings and figures of all policies, who is left out
        and why, where trained weights come from; and the protocol.

    Raises:
        SbmError: if the world cannot be built, or a trained policy is not for this version of it.
    """
    from agents.evaluation.run import evaluate_policies

    env_id, size = WORLDS[world], SIZES[context.scale]
    num_episodes, num_labelled = size.streets if world == "streets" else size.rooms
    available, left_out = available_policies(env_id, policies)
    config = evaluate_config(name, env_id, available, num_episodes, DETECTOR, context)
    with_labels = evaluate_config(
        f"{name}_labelled", env_id, available, num_labelled, DETECTOR, context, True, size.picture_px
    )
    labelled = evaluate_policies(with_labels)
    content = evaluate_policies(config, reuse=with_labels.out)
    for policy, found in labelled["policies"].items():
        content["policies"][policy] |= {"labels": found["labels"], "early": found["early"]}
    for pair, found in labelled["pairs"].items():
        content["pairs"][pair] |= {name: value for name, value in found.items() if "@" in name}
    figures = {
        **_figures(content, env_id, available, left_out),
        "labelled": {"episodes": num_labelled, "picture_px": size.picture_px},
    }
    return {"compared_with": policies[0], "worlds": {world: figures}, "protocol": labelled["protocol"]}


def _figures(
    content: Mapping[str, Any], env_id: str, policies: Sequence[str], left_out: Mapping[str, str]
) -> dict[str, Any]:
    """What the record says of a world."""
    return {
        "settings": content["settings"],
        "left_out": left_out,
        "trained": training_of(policies, env_id),
        "policies": content["policies"],
        "pairs": content["pairs"],
    }


def available_policies(env_id: str, policies: Sequence[str]) -> tuple[tuple[str, ...], dict[str, str]]:
    """Which of the policies there are for an env, and why there is none of the others."""
    from agents.policies.registry import checkpoint_of
    from labeling.core.errors import UsageError

    there, left_out = [], {}
    for policy in policies:
        try:
            checkpoint_of(policy, env_id)
        except UsageError as error:
            left_out[policy] = str(error)
        else:
            there.append(policy)
    return tuple(there), left_out


def evaluate_config(
    experiment: str,
    env_id: str,
    policies: tuple[str, ...],
    episodes: int,
    detector: str,
    context: RunContext,
    labels: bool = False,
    picture_px: int | None = None,
    more: Sequence[str] = (),
) -> "EvaluateConfig":
    """How policies are evaluated, in another folder whenever something changes that decides their results.

    Args:
        experiment: whose folder in the cache.
        env_id: Gymnasium id of the world.
        policies: names; differences are to the first.
        episodes: of each policy and seed.
        detector: in the loop.
        context: seeds, workers and cache.
        labels: make labels of the views, too.
        picture_px: height of the pictures that labels are made on; None is the world's own.
        more: what else decides the results.
    """
    from agents.evaluation.evaluate_config import EvaluateConfig
    from agents.evaluation.run import Evaluator
    from labeling.runtime.provenance import experiment_versions
    from sbm_gym.assets.catalog.same_libraries import library_digests
    from sbm_gym.env.view_detectors import digest_of_detector

    settings = [env_id, SPLIT, SCENES, detector, picture_px]
    behind = [experiment_versions(), code_digest(Evaluator), digest_of_detector(detector), library_digests(), *more]
    name = digest(settings, *behind)
    return EvaluateConfig(
        policies=policies,
        env=env_id,
        split=SPLIT,
        scenes=SCENES,
        episodes=episodes,
        seeds=len(context.seeds),
        detector=detector,
        labels=labels,
        label_views=LABEL_VIEWS,
        size=picture_px,
        workers=context.workers,
        where=context.where,
        out=context.cache / experiment / f"{env_id.rpartition('/')[2]}-{name}",
    )


def training_of(policies: Sequence[str], env_id: str) -> dict[str, dict[str, Any]]:
    """How those policies were trained whose weights come with the project."""
    from agents.evaluation.results import policy_key
    from agents.policies.registry import checkpoint_of
    from experiments.tables.trained_policies import origin_of

    found = {}
    for policy in policies:
        checkpoint = checkpoint_of(policy, env_id)
        if checkpoint is not None:
            found[policy] = {"checkpoint": policy_key(policy, env_id), **origin_of(checkpoint)}
    return found
