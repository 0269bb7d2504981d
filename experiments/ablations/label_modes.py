"""The label generator's presets side by side: the default, the thesis as written, and the code published with it."""

from dataclasses import asdict, fields, replace
from typing import Any

from experiments.ablations.label_scores import Setting
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from experiments.tables.thesis_tables import Row, Table
from experiments.tables.training_sets import STREETS
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PRESETS
from labeling.generator.settings.published_defects import PublishedDefects

BASE = "paper"
DETECTORS = Table(
    "rooms: detectors fine-tuned on the labels of each preset, on 40 unseen interiors",
    "rooms",
    (
        Row("pre-trained", "wide"),
        Row("default labels", "learn", labels="sbm"),
        Row("paper labels", "learn", labels="paper"),
        Row("released labels", "learn", labels="released"),
        Row("fine-tuned on default", "wide", teacher="sbm"),
        Row("fine-tuned on paper", "wide", teacher="paper"),
        Row("fine-tuned on released", "wide", teacher="released"),
    ),
)


@experiment(
    "label_modes",
    "the presets default, paper and released: labels on validation scenes, and detectors fine-tuned on them",
    pages=("label_generator", "results"),
)
def run(context: RunContext) -> dict[str, Any]:
    """Labels the validation episodes under every preset.

    Returns:
        The settings, the pools, and the figures.
    """
    from experiments.ablations.label_comparison import compare
    from experiments.cache.episode_pool import ablation_pools

    about: dict[str, Any] = {}
    results: dict[str, Any] = {}
    settings = modes(context.scale)
    for pool in ablation_pools(context.scale):
        if pool.split != "val":
            continue
        streets = pool.name.startswith("streets")
        named = {"detector": [Setting(None)]}
        for name, config in settings.items():
            own = replace(config, **STREETS) if streets and not config.fuse_views else config
            named[name] = [Setting(replace(own, seed=seed)) for seed in context.seeds]
        some_about, some_results = compare(named, BASE, [pool], context, f"label modes, {pool.name}")
        about |= some_about
        for name, found in some_results.items():
            results.setdefault(name, {}).update(found)
    return {
        "settings": {name: asdict(config) for name, config in settings.items()},
        "streets": STREETS,
        "pools": about,
        "results": results,
        "taught": DETECTORS.run(context),
    }


def modes(scale: Scale) -> dict[str, LabelConfig]:
    """The settings compared."""
    found: dict[str, LabelConfig] = {**PRESETS}
    if scale in ("standard", "full"):
        for one in fields(PublishedDefects):
            found[f"paper, {one.name}"] = replace(PRESETS["paper"], published=PublishedDefects(**{one.name: True}))
    return found
