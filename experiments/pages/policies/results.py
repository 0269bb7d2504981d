"""The page about policies: what they earn, what their labels teach, and how they were trained."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from experiments.pages.markdown import Pictures, read_result, render
from experiments.pages.policies.comparison import compared, earned_table, pairs_table
from experiments.pages.policies.teaching import taught
from experiments.pages.policies.training import seeds_of, training_runs
from labeling.core.errors import SbmError

PAGE = "policies-results.md"
EVALUATION = ("policy_evaluation.json", "policy_evaluation_streets.json")
"""A file for each world."""
UNMAPPED = ("policy_evaluation_unmapped.json", "policy_evaluation_unmapped_streets.json")
WIDE = "policy_evaluation_wide.json"
TEACHING = ("policies.json", "policies_streets.json")
ABLATION = "reward_ablation.json"
BOUND = "policy_bound.json"
OF_LABELS = (*EVALUATION, *UNMAPPED, BOUND, *TEACHING)
"""Files of results whose figures depend on labels."""
TRAINING, WAYS = "policy_training_*.json", "policy_pictures_*.json"
PICTURES = {"learning": "policies_learning.png", "labels": "policies_labels.png", "ablation": "policies_rewards.png"}
SPLITS = {"train": "training", "val": "validation", "test": "test", "wide": "wide", "endless": "unseen endless"}


def compose(results: Path) -> tuple[str, Pictures]:
    """The page, and those of its pictures that are drawn from figures."""
    from experiments.figures.policies import draw_labels_by_views, draw_learning, draw_reward_ablation

    found = read_results(results)
    pictures: Pictures = {}
    if found["training"]:
        pictures[PICTURES["learning"]] = partial(draw_learning, seeds_of(found["training"]))
    if found["evaluation"]:
        pictures[PICTURES["labels"]] = partial(draw_labels_by_views, found["evaluation"]["worlds"])
    if found["ablation"]:
        pictures[PICTURES["ablation"]] = partial(draw_reward_ablation, found["ablation"])
    return page(found), pictures


def read_results(results: Path) -> dict[str, Any]:
    """The contents of the files that are there by what they are about, of training and trajectories also by env.

    Raises:
        SbmError: if there is none, or a file is damaged.
    """
    files = {"wide": WIDE, "ablation": ABLATION, "bound": BOUND}
    found: dict[str, Any] = {name: read_result(results / file) for name, file in files.items()}
    for name, of_worlds in (("evaluation", EVALUATION), ("unmapped", UNMAPPED), ("teaching", TEACHING)):
        found[name] = _together([read_result(results / file) for file in of_worlds])
    for name, pattern in {"training": TRAINING, "ways": WAYS}.items():
        paths = sorted(results.glob(pattern))
        found[name] = {path.stem[pattern.index("*") :]: read_result(path) for path in paths}
    if not any(found.values()):
        raise SbmError(
            f"{results}: no {', '.join((*EVALUATION, *TEACHING))}, {ABLATION} or {TRAINING}; python -m experiments.run "
            "policy_evaluation makes the first"
        )
    return found


def page(results: Mapping[str, Any]) -> str:
    """The text of the page."""
    return render(
        "policies-results.md.jinja",
        evaluation=_with_worlds(results["evaluation"], compared),
        unmapped=_with_worlds(results["unmapped"], compared),
        wide=_with_worlds(
            results["wide"], lambda world, base: {"earned": earned_table(world), "pair_table": pairs_table(world)}
        ),
        teaching=_with_worlds(results["teaching"], taught),
        ways=results["ways"],
        training=results["training"] and training_runs(results["training"]),
        ablation=_with_worlds(results["ablation"], lambda world, base: {"earned": earned_table(world)}),
        bound=results["bound"] and {**results["bound"], "rows": _ways_from_one_start(results["bound"])},
        splits=SPLITS,
        files=PICTURES,
    )


def _with_worlds(
    content: Mapping[str, Any] | None, section: Callable[[Mapping[str, Any], str], dict[str, Any]]
) -> dict[str, Any] | None:
    """Results with what the page tells of each world, and the settings that all worlds share."""
    if content is None:
        return None
    base, worlds = content["compared_with"], content["worlds"]
    sections = [{**world, "name": name, **section(world, base)} for name, world in worlds.items()]
    return {**content, "worlds": sections, "settings": next(iter(worlds.values())).get("settings")}


def _together(contents: Sequence[Mapping[str, Any] | None]) -> dict[str, Any] | None:
    """Records of single worlds as one; each world says the scale and the seeds it was run with."""
    there = [content for content in contents if content is not None]
    worlds = {
        world: {**found, "scale": content["scale"], "seeds": content["seeds"]}
        for content in there
        for world, found in content["worlds"].items()
    }
    return {**there[0], "worlds": worlds} if there else None


def _ways_from_one_start(content: Mapping[str, Any]) -> list[list[str]]:
    """Rows: right labels of the mean way and of the best one, by policy and number of views."""
    return [
        [f"`{policy}`", *(f"{figures[which]:.1f}" for figures in found.values() for which in ("mean", "best"))]
        for policy, found in content["policies"].items()
    ]
