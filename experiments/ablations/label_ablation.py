"""The ablation of the label generator: one setting at a time around the default, paired over episodes."""

from dataclasses import asdict
from typing import Any

from experiments.ablations.ablation_variants import FACTORS, NOT_STUDIED, variants
from experiments.ablations.label_scores import Setting
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from labeling.generator.settings.label_config import LabelConfig

BASE = "default"
DETECTOR = "detector"


@experiment(
    "label_ablation",
    "every setting of the label generator, varied alone around its default",
    pages=("label_generator",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Runs the ablation.

    Returns:
        The default, the pools, and the figures of every variant.
    """
    from experiments.ablations.label_comparison import compare
    from experiments.cache.episode_pool import ablation_pools

    chosen = variants(context.scale)
    named = {BASE: [Setting(LabelConfig(seed=seed)) for seed in context.seeds], DETECTOR: [Setting(None)]}
    for factor, one in chosen:
        named[_key(factor.title, one.name)] = [Setting(one.config(seed)) for seed in context.seeds]
    about, results = compare(named, BASE, ablation_pools(context.scale), context, "label ablation")
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
