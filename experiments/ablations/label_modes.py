"""The label generator's presets side by side: the default, the thesis as written, and the code published with it."""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from experiments.cache.stages import Scale, Workplace
from experiments.tables.thesis_tables import Row, Table
from experiments.tables.training_sets import STREETS
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.presets import PRESETS
from labeling.generator.settings.published_defects import PublishedDefects

DESCRIPTION = "the presets default, paper and released: labels on validation scenes, and detectors taught by them"
BASE = "paper"
TAUGHT = Table(
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


def run(workplace: Workplace) -> dict[str, Any]:
    """Labels the validation episodes under every preset.

    Returns:
        The settings, the pools, and the figures.
    """
    from experiments.ablations.label_comparison import compare
    from experiments.cache.episode_pool import pools

    about: dict[str, Any] = {}
    results: dict[str, Any] = {}
    settings = modes(workplace.scale)
    for pool in pools(workplace.scale):
        if pool.split != "val":
            continue
        streets = pool.name.startswith("streets")
        named: dict[str, list[LabelConfig | None]] = {"detector": [None]}
        for name, config in settings.items():
            own = replace(config, **STREETS) if streets and not config.fuse_views else config
            named[name] = [replace(own, seed=seed) for seed in workplace.seeds]
        some_about, some_results = compare(named, BASE, [pool], workplace, f"label modes, {pool.name}")
        about |= some_about
        for name, found in some_results.items():
            results.setdefault(name, {}).update(found)
    return {
        "settings": {name: asdict(config) for name, config in settings.items()},
        "streets": STREETS,
        "pools": about,
        "results": results,
        "taught": TAUGHT.run(workplace),
    }


def modes(scale: Scale) -> dict[str, LabelConfig]:
    """The settings compared."""
    found: dict[str, LabelConfig] = {**PRESETS}
    if scale == "full":
        for one in fields(PublishedDefects):
            found[f"paper, {one.name}"] = replace(PRESETS["paper"], published=PublishedDefects(**{one.name: True}))
    return found


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about the label generator's defaults, and the page of all results.

    Returns:
        The files written.
    """
    from experiments import results_page
    from experiments.pages import label_generator
    from labeling.io.formats.checked_json import read_json

    written = label_generator.write_page(results, docs)
    taught = "taught" in read_json(results / "label_modes.json").mapping()
    return [*written, *results_page.write_page(results, docs)] if taught else written
