"""The ablation of the label generator: one setting at a time around the default, paired over episodes."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.ablations.ablation_variants import FACTORS, NOT_STUDIED, variants
from experiments.cache.stages import Workplace
from labeling.generator.settings.label_config import LabelConfig

DESCRIPTION = "every setting of the label generator, varied alone around its default"
BASE = "default"
DETECTOR = "detector"


def run(workplace: Workplace) -> dict[str, Any]:
    """Runs the ablation.

    Returns:
        The default, the pools, and the figures of every variant.
    """
    from experiments.ablations.label_comparison import compare
    from experiments.cache.episode_pool import pools

    chosen = variants(workplace.scale)
    named: dict[str, list[LabelConfig | None]] = {
        BASE: [LabelConfig(seed=seed) for seed in workplace.seeds],
        DETECTOR: [None],
    }
    for factor, one in chosen:
        named[_key(factor.title, one.name)] = [one.config(seed) for seed in workplace.seeds]
    about, results = compare(named, BASE, pools(workplace.scale), workplace, "label ablation")
    return {
        "default": asdict(LabelConfig()),
        "pools": about,
        "results": {BASE: results[BASE], DETECTOR: results[DETECTOR]},
        "factors": [
            {
                "title": factor.title,
                "settings": list(factor.settings),
                "why": factor.why,
                "variants": [
                    {"name": one.name, "changes": one.changes, "results": results[_key(factor.title, one.name)]}
                    for other, one in chosen
                    if other is factor
                ],
            }
            for factor in FACTORS
        ],
        "not_studied": NOT_STUDIED,
    }


def _key(factor: str, variant: str) -> str:
    return f"{factor}: {variant}"


def report(results: Path, docs: Path) -> list[Path]:
    """Writes the page about the label generator's defaults.

    Returns:
        The files written.
    """
    from experiments.pages.label_generator import write_page

    return write_page(results, docs)
