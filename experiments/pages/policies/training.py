"""How policies were trained."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.pages.markdown import table
from experiments.pages.policies.cells import interval

COMPARED = ("random", "ring", "next_best_view")
"""Beside which ``agents.train`` puts what it has trained."""
SEED = re.compile(r"[-_]seed[-_]\d+$")
"""How names of records end that differ in the seed of training."""


def training_runs(contents: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
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
