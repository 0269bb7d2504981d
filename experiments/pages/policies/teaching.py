"""What detectors learn from the views of policies."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.figures.result_values import interval_of_draws, mean_of_drawn_seeds
from experiments.pages.markdown import mean_std, points, table
from experiments.pages.policies.cells import PERCENT
from experiments.tables.policies import views_of

LEARNT_FROM = {"labels": "after labels of `{}`", "truth": "after ground truth of the views of `{}`"}
"""Teachers, and what rows are called."""
Runs = dict[tuple[str, str], list[Mapping[str, Any]]]
"""By teacher and policy, one for each seed."""


def taught(world: Mapping[str, Any], base: str) -> dict[str, Any]:
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
    recordings = [pool for name, pool in pools.items() if name.startswith(f"{base}_") and name.endswith("_learn")]
    return {
        "rows": rows,
        "by_category": _by_category(world, base),
        "by_views": _by_views(world, base),
        "differences": _differences(world, base),
        "errors": _errors(world, base),
        "episodes": recordings[0]["episodes"],
        "recordings": len(recordings),
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
    rows, scenes = [], len(set(world["pools"]["dev"]["scenes"]))
    for (teacher, policy), ours in runs.items():
        if policy != base:
            cells = [_above(ours, runs[teacher, base], figure, scenes) for figure in figures]
            rows.append([LEARNT_FROM[teacher].format(policy), *cells])
    for policy in dict.fromkeys(policy for _, policy in runs):
        if ("truth", policy) in runs:
            cells = [_above(runs["truth", policy], runs["labels", policy], figure, scenes) for figure in figures]
            rows.append([f"ground truth instead of labels of the views of `{policy}`", *cells])
    return table(["", *figures.values()], rows)


def _above(ours: Sequence[Mapping[str, Any]], theirs: Sequence[Mapping[str, Any]], figure: str, scenes: int) -> str:
    """Difference of means over seeds, points, and its 95 % interval over scenes, the same for both, and seeds drawn
    again. Training sets of the same seed have the same scenes, so differences by seed are drawn.
    """
    by_seed = [np.array([run["dev"]["resampled"][figure] for run in runs]) for runs in (ours, theirs)]
    means = [float(np.mean([run["dev"][figure] for run in runs])) for runs in (ours, theirs)]
    drawn = mean_of_drawn_seeds(by_seed[0] - by_seed[1])
    low, high = (PERCENT * end for end in interval_of_draws(drawn, means[0] - means[1], scenes))
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
