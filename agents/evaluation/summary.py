"""From the results of episodes to ``evaluation.json``."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.label_quality import AP_THRESHOLDS, EARLY_VIEWS, episode_figures, pooled_ap
from agents.evaluation.statistics import MIN_SCENES, MIN_STARTS, interval_record, over_seeds, paired_record, rounded
from agents.policies.registry import SEED
from labeling.metrics.average_precision import mean_of
from labeling.runtime.provenance import SIMULATION_PACKAGES, package_versions

SCHEMA_VERSION = 1
EARLY_FIGURES = ("right", "objects", "ap50")
PAIR_FIGURES = ("return", *EARLY_FIGURES)
"""Of these, differences between any two policies are told, those of labels after each number of views."""
PROTOCOL = tomllib.loads(Path(__file__).with_name("protocol.toml").read_text(encoding="utf-8"))
"""How the figures come about; written beside them."""


Plays = list[dict[str, Any]]
"""Results of one start: one, or as many as a policy that draws at random has played it."""


def summary(config: EvaluateConfig, records: dict[str, list[Plays]]) -> dict[str, Any]:
    """Sums up.

    Args:
        config: the settings.
        records: by policy the results of its starts, seed by seed.

    Returns:
        Content of ``evaluation.json``. Trainings that differ in their seed are there one by one, and as one policy
        whose every start all of them have played.
    """
    base = config.policies[0]
    records = {**records, **over_trainings(records)}
    per_episode = {policy: [_flat(plays) for plays in found] for policy, found in records.items()}
    scenes = [plays[0]["scene"] for plays in records[base]]
    names = list(dict.fromkeys(name for found in per_episode.values() for figures in found for name in figures))
    policies = {}
    for policy, found in records.items():
        figures = {}
        for name in names:
            values = [one.get(name) for one in per_episode[policy]]
            theirs = [one.get(name) for one in per_episode[base]]
            figures[name] = {
                **over_seeds([mean_of(part) for part in _by_seed(values, config.seeds)]),
                **interval_record(values, scenes),
                "difference": None if policy == base else paired_record(values, theirs, scenes),
            }
        policies[policy] = {
            "figures": {name: value for name, value in figures.items() if "@" not in name},
            "labels": _label_figures(config, found, figures),
            "early": _early(per_episode[policy], per_episode[base], scenes, max(config.label_views, default=0)),
            "curves": _curves(config, found),
        }
    return {
        "schema_version": SCHEMA_VERSION,
        "settings": {
            "env": config.env,
            "split": config.split,
            "detector": config.detector,
            "reward": config.reward,
            "episodes": config.episodes,
            "seeds": list(range(config.seeds)),
            "size": config.size,
            "draws": config.draws,
            "scenes": sorted(set(scenes)),
        },
        "compared_with": base,
        "shown_with": {"starts": MIN_STARTS, "scenes": MIN_SCENES},
        "policies": policies,
        "pairs": _pairs(per_episode, scenes),
        "protocol": PROTOCOL,
        "versions": package_versions(SIMULATION_PACKAGES),
    }


def over_trainings(records: dict[str, list[Plays]]) -> dict[str, list[Plays]]:
    """Policies NAME, NAME_seed_1, NAME_seed_2, ... as one, "NAME of N trainings": each start with the plays of all."""
    found = {}
    for name in records:
        seeds = [other for other in records if (match := SEED.fullmatch(other)) and match.group(1) == name]
        if seeds:
            trainings = [records[one] for one in (name, *seeds)]
            together = [[play for plays in starts for play in plays] for starts in zip(*trainings, strict=True)]
            found[f"{name} of {len(trainings)} trainings"] = together
    return found


def _pairs(
    per_episode: dict[str, list[dict[str, float | None]]], scenes: Sequence[str]
) -> dict[str, dict[str, dict[str, Any] | None]]:
    """Paired differences of each policy to those before it: ``policy minus other`` -> figure -> difference."""
    found = {}
    names = list(dict.fromkeys(name for figures in per_episode.values() for one in figures for name in one))
    names = [name for name in names if name.partition("@")[0] in PAIR_FIGURES and name != "objects"]
    for number, (policy, ours) in enumerate(per_episode.items()):
        for other, theirs in list(per_episode.items())[:number]:
            values = {name: ([one.get(name) for one in ours], [one.get(name) for one in theirs]) for name in names}
            found[f"{policy} minus {other}"] = {name: paired_record(*both, scenes) for name, both in values.items()}
    return found


def _flat(plays: Plays) -> dict[str, float | None]:
    """All figures of a start by name, those of labels as ``name@views``: means over its plays."""
    each = []
    for record in plays:
        found: dict[str, float | None] = dict(record["figures"])
        if "label_quality" in record:
            for count, figures in episode_figures(record["label_quality"]).items():
                found.update({f"{name}@{count}": value for name, value in figures.items()})
        each.append(found)
    return {name: mean_of([one[name] for one in each]) for name in each[0]}


def _by_seed(values: Sequence[Any], seeds: int) -> list[Sequence[Any]]:
    length = len(values) // seeds
    return [values[seed * length : (seed + 1) * length] for seed in range(seeds)]


def _label_figures(
    config: EvaluateConfig, records: list[Plays], figures: dict[str, Any]
) -> dict[str, dict[str, Any]] | None:
    """Views -> figures; None where no labels were made."""
    if not config.labels:
        return None
    found: dict[str, dict[str, Any]] = {}
    for name, value in figures.items():
        figure, at, count = name.partition("@")
        if at:
            found.setdefault(count, {})[figure] = value
    parts = _by_seed(records, config.seeds)
    for count, row in found.items():
        pooled = [pooled_ap([record["label_quality"] for plays in part for record in plays], count) for part in parts]
        for name in AP_THRESHOLDS:
            row[f"pooled_{name}"] = over_seeds([one[name] for one in pooled])
    return found


def _early(
    ours: list[dict[str, Any]], base: list[dict[str, Any]], scenes: Sequence[str], end: int
) -> dict[str, Any] | None:
    """A policy's labels after half the views beside those of the first policy after all; None where there are none."""
    early = EARLY_VIEWS
    if not all(f"right@{early}" in one for one in ours) or not all(f"right@{end}" in one for one in base):
        return None
    differences = {
        name: paired_record([one[f"{name}@{early}"] for one in ours], [one[f"{name}@{end}"] for one in base], scenes)
        for name in EARLY_FIGURES
    }
    return {"views": early, "base_views": end, "difference": differences}


def _curves(config: EvaluateConfig, records: list[Plays]) -> dict[str, Any]:
    """Return and sectors after each view: mean and standard deviation over seeds, as for all figures."""
    found = {}
    for name, series in (
        ("return", [_over_plays(plays, "reward").cumsum() for plays in records]),
        ("sectors", [_over_plays(plays, "sectors") for plays in records]),
    ):
        seeds = np.array([np.mean(part, axis=0) for part in _by_seed(series, config.seeds)])
        found[name] = {
            "mean": [rounded(value) for value in seeds.mean(axis=0)],
            "std": [rounded(value) for value in seeds.std(axis=0, ddof=1)] if len(seeds) > 1 else None,
        }
    return found


def _over_plays(plays: Plays, name: str) -> np.ndarray:
    """A figure after each view, mean over the plays of a start."""
    return np.mean([[step[name] for step in record["steps"]] for record in plays], axis=0)
