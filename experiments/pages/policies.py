"""The page about policies: what they earn, what their labels teach, and how they were trained."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.statistics import shown_sign
from experiments.pages.markdown import Pictures, mean_std, points, read_result, render, table
from experiments.tables.policies import views_of
from labeling.core.errors import SbmError

PAGE = "policies-results.md"
EVALUATION = ("policy_evaluation.json", "policy_evaluation_streets.json")
"""A file for each world."""
WIDE = "policy_evaluation_wide.json"
TEACHING = ("policies.json", "policies_streets.json")
ABLATION = "reward_ablation.json"
BOUND = "policy_bound.json"
TRAINING, WAYS = "policy_training_*.json", "policy_pictures_*.json"
PICTURES = {"learning": "policies_learning.png", "labels": "policies_labels.png", "ablation": "policies_rewards.png"}
SPLITS = {"train": "training", "val": "validation", "test": "test", "wide": "wide", "endless": "unseen endless"}
PERCENT = 100
COMPARED = ("random", "ring", "next_best_view")
"""Beside which ``agents.train`` puts what it has trained."""
SEED = re.compile(r"[-_]seed[-_]\d+$")
"""How names of records end that differ in the seed of training."""
EARNED = {
    **{name: (name, 1) for name in ("return", "discovery", "diversity", "objects")},
    "sectors": ("sectors seen", 1),
    "collisions": ("collisions", 1),
    "path_m": ("path (m)", 1),
}
"""Heading and factor by figure."""
LABELLED = {
    "pooled_ap50": ("AP50 pooled", PERCENT),
    "ap50": ("AP50 an episode", PERCENT),
    "right": ("correct labels", 1),
    "objects": ("objects labelled correctly", 1),
}
EARLY = {name: LABELLED[name] for name in ("right", "objects", "ap50")}


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
    for name, of_worlds in (("evaluation", EVALUATION), ("teaching", TEACHING)):
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
        evaluation=_with_worlds(results["evaluation"], _compared),
        wide=_with_worlds(results["wide"], lambda world, base: {"earned": _earned(world), "pair_table": _pairs(world)}),
        teaching=_with_worlds(results["teaching"], _taught),
        ways=results["ways"],
        training=results["training"] and _training(results["training"]),
        ablation=_with_worlds(results["ablation"], lambda world, base: {"earned": _earned(world)}),
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


# Comparison ----------------------------------------------------------------------------------------------------------


def _together(contents: Sequence[Mapping[str, Any] | None]) -> dict[str, Any] | None:
    """Records of single worlds as one; each world says the scale it was run at."""
    there = [content for content in contents if content is not None]
    worlds = {
        world: {**found, "scale": content["scale"]} for content in there for world, found in content["worlds"].items()
    }
    return {**there[0], "worlds": worlds} if there else None


def _compared(world: Mapping[str, Any], base: str) -> dict[str, Any]:
    labelled = {policy: found for policy, found in world["policies"].items() if found["labels"] is not None}
    views, early = max(labelled[base]["labels"], key=int), labelled[base]["early"]
    if early is not None:
        rows = []
        for policy, found in labelled.items():
            differences = found["early"]["difference"]
            rows.append([f"`{policy}`", *(interval(differences[name], factor) for name, (_, factor) in EARLY.items())])
        early = {**early, "table": table(["", *(heading for heading, _ in EARLY.values())], rows)}
    labels = figures_table(LABELLED, {policy: found["labels"][views] for policy, found in labelled.items()})
    return {"earned": _earned(world), "labels": labels, "views": views, "early": early, "pair_table": _pairs(world)}


def _pairs(world: Mapping[str, Any]) -> str | None:
    """What the trained policy has above each other one: paired differences with intervals."""
    pairs = {name: found for name, found in world.get("pairs", {}).items() if _is_told(name, world["policies"])}
    if not pairs:
        return None
    names = list(dict.fromkeys(name for found in pairs.values() for name in found))
    heads = {name: LABELLED[name.partition("@")[0]] if "@" in name else EARNED[name] for name in names}
    headings = [
        f"{heading}, {name.partition('@')[2]} views" if "@" in name else heading for name, (heading, _) in heads.items()
    ]
    rows = [
        [f"`{pair.replace(' minus ', '` minus `')}`", *(interval(found.get(name), heads[name][1]) for name in names)]
        for pair, found in pairs.items()
    ]
    return table(["", *headings], rows)


def _is_told(pair: str, policies: Iterable[str]) -> bool:
    """Whether a pair is of a learnt policy and another; trainings from several seeds count as one."""
    ours, _, theirs = pair.partition(" minus ")
    several = {name.partition(" of ")[0] for name in policies if " of " in name}
    single = any(name.partition("_seed_")[0] in several for name in (ours, theirs))
    return ours.startswith("ppo") and not single


def _earned(world: Mapping[str, Any]) -> str:
    return figures_table(EARNED, {policy: found["figures"] for policy, found in world["policies"].items()})


def figures_table(headings: Mapping[str, tuple[str, float]], policies: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of figures with their deviation, one row for each policy; bold where the difference is shown.

    Args:
        headings: by figure, its heading and what it is multiplied with.
        policies: by policy its figures, as ``agents.evaluation`` sums them up.
    """
    rows = [
        [f"`{policy}`", *(cell(figures.get(name), factor) for name, (_, factor) in headings.items())]
        for policy, figures in policies.items()
    ]
    return table(["", *(heading for heading, _ in headings.values())], rows)


def cell(figure: Mapping[str, Any] | None, factor: float = 1) -> str:
    """Mean and deviation of a figure; bold where its difference is shown.

    Args:
        figure: as ``agents.evaluation`` sums it up.
        factor: to multiply it with.
    """
    if figure is None or figure["mean"] is None:
        return "-"
    digits = 1 if factor == PERCENT else 2
    mean, std = f"{factor * figure['mean']:.{digits}f}", figure["std"]
    difference = figure.get("difference")
    if shown_sign(difference):
        mean = f"**{mean}**"
    return mean if std is None else f"{mean} ± {factor * std:.{digits}f}"


def interval(difference: Mapping[str, Any] | None, factor: float = 1) -> str:
    """A difference with its interval; bold where it is shown."""
    if difference is None:
        return "-"
    digits = 1 if factor == PERCENT else 2
    mean = f"{factor * difference['mean']:+.{digits}f}"
    if difference["low"] is None:
        return mean
    low, high = (f"{factor * difference[name]:+.{digits}f}" for name in ("low", "high"))
    return f"{f'**{mean}**' if shown_sign(difference) else mean} [{low}, {high}]"


# What is left to gain ------------------------------------------------------------------------------------------------


def _ways_from_one_start(content: Mapping[str, Any]) -> list[list[str]]:
    """Rows: right labels of the mean way and of the best one, by policy and number of views."""
    return [
        [f"`{policy}`", *(f"{figures[which]:.1f}" for figures in found.values() for which in ("mean", "best"))]
        for policy, found in content["policies"].items()
    ]


# What detectors learn ------------------------------------------------------------------------------------------------


LEARNT_FROM = {"labels": "after labels of `{}`", "truth": "after ground truth of the views of `{}`"}
"""Teachers, and what rows are called."""
Runs = dict[tuple[str, str], list[Mapping[str, Any]]]
"""By teacher and policy, one for each seed."""


def _taught(world: Mapping[str, Any], base: str) -> dict[str, Any]:
    """Rows: the detector before, and after the labels, or the ground truth, of each policy's views."""
    parts = (("dev", "mask_ap50"), ("dev", "box_ap50"), ("dev", "mask_ap30"), ("photographs", "mask_ap50"))
    runs = _runs(world)
    rows = [["before", "-", *(points(world["before"][part][figure]) for part, figure in parts)]]
    for (teacher, policy), found in runs.items():
        ours, theirs = (_label_scores(world, one) if teacher == "labels" else [] for one in (policy, base))
        cells = [_beside(ours, theirs)] if ours else ["-"]
        for part, figure in parts:
            cells.append(_beside(*([run[part][figure] for run in some] for some in (found, runs[teacher, base]))))
        rows.append([LEARNT_FROM[teacher].format(policy), *cells])
    pools = world["pools"]
    return {
        "rows": rows,
        "by_category": _by_category(world, base),
        "by_views": _by_views(world, base),
        "differences": _differences(world, base),
        "errors": _errors(world, base),
        "episodes": pools[f"{base}_learn"]["episodes"],
        "scenes": len(set(pools["dev"]["scenes"])),
    }


def _runs(world: Mapping[str, Any]) -> Runs:
    """Those on labels first. Older results know no other teacher."""
    found: Runs = {}
    for teacher in LEARNT_FROM:
        for run in world["runs"]:
            if run.get("teacher", "labels") == teacher:
                found.setdefault((teacher, run["policy"]), []).append(run)
    return found


def _label_scores(world: Mapping[str, Any], policy: str) -> list[float]:
    return [one["pseudo_labels"]["mask_ap50"] for one in world["labels"] if one["policy"] == policy]


def _by_category(world: Mapping[str, Any], base: str) -> str:
    """Mask AP50 of each category in the scenes to be tested in, before and after learning from each policy's views."""
    before = world["before"]["dev"]["per_class_ap50"]
    known = [name for name, value in before.items() if value is not None]
    rows, runs = [["before", *(points(before[name]) for name in known)]], _runs(world)
    for (teacher, policy), found in runs.items():
        cells = [
            _beside(*([run["dev"]["per_class_ap50"][name] for run in some] for some in (found, runs[teacher, base])))
            for name in known
        ]
        rows.append([LEARNT_FROM[teacher].format(policy), *cells])
    return table(["", *known], rows)


def _errors(world: Mapping[str, Any], base: str) -> str | None:
    """How many labels are false, in all and of each category; None in results that do not tell."""
    if any("errors" not in one for one in world["labels"]):
        return None
    of_policy: dict[str, list[Mapping[str, Any]]] = {}
    for one in world["labels"]:
        of_policy.setdefault(one["policy"], []).append(one["errors"])
    known = [name for name, value in world["before"]["dev"]["per_class_ap50"].items() if value is not None]
    rows = []
    for policy, found in of_policy.items():
        weights = ([one["false_weight"] for one in some] for some in (found, of_policy[base]))
        rows.append([f"`{policy}`", _beside(*weights), *(_false_of_all(found, name) for name in known)])
    return table(["", "of all, by weight", *known], rows)


def _false_of_all(found: Sequence[Mapping[str, Any]], category: str) -> str:
    """Mean counts over seeds of false labels of a category, and of all."""
    counts = [one["categories"].get(category, {"false": 0, "labels": 0}) for one in found]
    return " of ".join(f"{np.mean([one[what] for one in counts]):.0f}" for what in ("false", "labels"))


def _differences(world: Mapping[str, Any], base: str) -> str | None:
    """By how much more is learnt than from the first policy's views, with intervals over scenes; None in results whose
    scenes were not drawn again.
    """
    runs, figures = _runs(world), {"mask_ap50": "mask AP50", "box_ap50": "box AP50"}
    if any(run["dev"].get("resampled") is None for found in runs.values() for run in found):
        return None
    rows = []
    for (teacher, policy), ours in runs.items():
        if policy != base:
            cells = [_above(ours, runs[teacher, base], figure) for figure in figures]
            rows.append([LEARNT_FROM[teacher].format(policy), *cells])
    for policy in dict.fromkeys(policy for _, policy in runs):
        if ("truth", policy) in runs:
            cells = [_above(runs["truth", policy], runs["labels", policy], figure) for figure in figures]
            rows.append([f"ground truth instead of labels of the views of `{policy}`", *cells])
    return table(["", *figures.values()], rows)


def _above(ours: Sequence[Mapping[str, Any]], theirs: Sequence[Mapping[str, Any]], figure: str) -> str:
    """Difference of means over seeds, points, and its 95 % interval over scenes drawn again, the same for both."""
    drawn = [np.mean([run["dev"]["resampled"][figure] for run in runs], axis=0) for runs in (ours, theirs)]
    low, high = np.quantile(PERCENT * (drawn[0] - drawn[1]), (0.025, 0.975))
    means = [np.mean([run["dev"][figure] for run in runs]) for runs in (ours, theirs)]
    text = f"{PERCENT * (means[0] - means[1]):+.1f}"
    return f"{f'**{text}**' if low * high > 0 else text} [{low:+.1f}, {high:+.1f}]"


def _by_views(world: Mapping[str, Any], base: str) -> str | None:
    """Mask AP50 on the views that each policy has of the scenes; None in results without them."""
    policies = dict.fromkeys(one["policy"] for one in world["runs"])
    if views_of(base) not in world["before"]:
        return None
    rows = [["before", *(points(world["before"][views_of(one)]["mask_ap50"]) for one in policies)]]
    runs = _runs(world)
    for (teacher, policy), found in runs.items():
        cells = [
            _beside(*([run[seen]["mask_ap50"] for run in some] for some in (found, runs[teacher, base])))
            for seen in map(views_of, policies)
        ]
        rows.append([LEARNT_FROM[teacher].format(policy), *cells])
    return table(["", *(f"views of `{policy}`" for policy in policies)], rows)


def _beside(ours: Sequence[float], base: Sequence[float]) -> str:
    """Mean and deviation over seeds in points; bold where every seed, of three or more, says the same."""
    text = mean_std([PERCENT * value for value in ours])
    if len(ours) >= 3 and abs(sum(np.sign(np.subtract(ours, base)))) == len(ours):
        mean, _, rest = text.partition(" ")
        return f"**{mean}** {rest}"
    return text


# Training ------------------------------------------------------------------------------------------------------------


def _training(contents: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """How policies were trained, the shipped ones and others, by record."""
    references = list(dict.fromkeys(name for content in contents.values() for name in content["references"]))
    rows = []
    for env, content in contents.items():
        first, best, settings = content["validations"][0], content["best"], content["settings"]
        known = [content["references"].get(name) for name in references]
        rows.append(
            [
                env,
                f"{content['rollouts'][-1]['at']:.0f}",
                f"{first['return']:.2f}" if first["at"] == 0 else "-",
                f"{best['return']:.2f}, {best['at']:.0f}",
                f"{content['checkpoint']['steps']}" if content.get("shipped", True) else "-",
                *("-" if figures is None else f"{figures['return']:.2f}" for figures in known),
                str(settings["eval_episodes"]),
                f"`{settings['detector']}`",
            ]
        )
    headings = ["", "steps", "validation return before", "best, at step", "shipped, at step"]
    headings += [*(f"`{name}`" for name in references), "episodes", "detector"]
    commands = {env: (content["command"], content.get("remark", "")) for env, content in contents.items()}
    of_seeds = seeds_of(contents)
    return {
        "table": table(headings, rows),
        "commands": commands,
        "seeds": _seeds(of_seeds),
        "unseen": _unseen(of_seeds),
    }


def seeds_of(contents: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """Runs that differ in nothing but the seed, under one name; those that were shipped come first.

    Args:
        contents: of ``policy_training_*.json``, by record.
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for name, content in sorted(contents.items(), key=lambda item: not item[1].get("shipped", True)):
        groups.setdefault(SEED.sub("", name), []).append(content)
    return groups


def _seeds(groups: Mapping[str, Sequence[Mapping[str, Any]]]) -> str | None:
    """How far validation return rises above ``random`` in several trainings, and how much they differ."""
    rows = []
    for name, runs in groups.items():
        if len(runs) < 2 or "random" not in runs[0]["references"]:
            continue
        before = [run["validations"][0]["return"] for run in runs]
        best, last = ([run["best"]["return"] for run in runs], [run["validations"][-1]["return"] for run in runs])
        random = runs[0]["references"]["random"]["return"]
        rise = (np.mean(last) - random) / np.std(last, ddof=1)
        cells = [" ".join(f"{value:.2f}" for value in values) for values in (before, best, last)]
        rows.append([name, f"{random:.2f}", *cells, f"{np.mean(last) - random:.2f}", f"{rise:.0f}"])
    headings = [
        "",
        "`random`",
        "untrained",
        "best",
        "at the end",
        "rise above `random`",
        "in standard deviations of seeds",
    ]
    return table(headings, rows) if rows else None


def _unseen(groups: Mapping[str, Sequence[Mapping[str, Any]]]) -> str | None:
    """What trained policies earn from unseen starts, and by how much they are above others; one row for each run."""
    rows = []
    for name, runs in groups.items():
        for run in runs:
            unseen = run.get("unseen")
            if unseen:
                found = unseen["policies"]
                above = [interval(found[other]["above"]) if other in found else "-" for other in ("first", *COMPARED)]
                earned = f"{found['best']['return']:.2f}"
                rows.append([f"{name}, seed {run['settings']['seed']}", str(unseen["starts"]), earned, *above])
    others = ["untrained", *(f"`{other}`" for other in COMPARED)]
    return table(["", "starts", "return", *(f"above {other}" for other in others)], rows) if rows else None
