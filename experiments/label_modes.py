"""The label generator's presets side by side: the default, the thesis as written, and the code published with it."""

from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from experiments.stages import Scale, Workplace
from labeling.label_config import LabelConfig
from labeling.presets import PRESETS
from labeling.published_defects import PublishedDefects

DESCRIPTION = "the presets default, paper and released on validation scenes; at full scale also each defect alone"
BASE = "paper"
STREETS = {"erosions": 3, "outlier_spread": 2.0, "crop_m": 6.0, "max_crop_m": 6.0}
"""The thesis' settings for streets. Source: field notes."""


def run(workplace: Workplace) -> dict[str, Any]:
    """Labels the validation episodes under every preset.

    Returns:
        The settings, the pools, and the figures.
    """
    from experiments.episode_pool import pools
    from experiments.label_comparison import compare

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
    }


def modes(scale: Scale) -> dict[str, LabelConfig]:
    """The settings compared."""
    found: dict[str, LabelConfig] = {**PRESETS}
    if scale == "full":
        for one in fields(PublishedDefects):
            found[f"paper, {one.name}"] = replace(PRESETS["paper"], published=PublishedDefects(**{one.name: True}))
    return found


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about the label generator's defaults.

    Returns:
        The files written.
    """
    from experiments.label_report import write_page

    return write_page(results, docs)
