"""What policies earn and how good their labels are, beside each other."""

from collections.abc import Iterable, Mapping
from typing import Any

from experiments.pages.markdown import table
from experiments.pages.policies.cells import PERCENT, figures_table, interval

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


def compared(world: Mapping[str, Any], base: str) -> dict[str, Any]:
    """Tables of a world: what policies earn, their labels of all views and of the first, and paired differences."""
    labelled = {policy: found for policy, found in world["policies"].items() if found["labels"] is not None}
    views, early = max(labelled[base]["labels"], key=int), labelled[base]["early"]
    if early is not None:
        rows = []
        for policy, found in labelled.items():
            differences = found["early"]["difference"]
            rows.append([f"`{policy}`", *(interval(differences[name], factor) for name, (_, factor) in EARLY.items())])
        early = {**early, "table": table(["", *(heading for heading, _ in EARLY.values())], rows)}
    labels = figures_table(LABELLED, {policy: found["labels"][views] for policy, found in labelled.items()})
    return {
        "earned": earned_table(world),
        "labels": labels,
        "views": views,
        "early": early,
        "pair_table": pairs_table(world),
    }


def pairs_table(world: Mapping[str, Any]) -> str | None:
    """What the trained policy has above each other one: paired differences with intervals."""
    pairs = {name: found for name, found in world.get("pairs", {}).items() if is_told(name, world["policies"])}
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


def is_told(pair: str, policies: Iterable[str]) -> bool:
    """Whether a pair is of a learnt policy and another; trainings from several seeds count as one."""
    ours, _, theirs = pair.partition(" minus ")
    several = {name.partition(" of ")[0] for name in policies if " of " in name}
    single = any(name.partition("_seed_")[0] in several for name in (ours, theirs))
    return ours.startswith("ppo") and not single


def earned_table(world: Mapping[str, Any]) -> str:
    """What policies earn, and how."""
    return figures_table(EARNED, {policy: found["figures"] for policy, found in world["policies"].items()})
