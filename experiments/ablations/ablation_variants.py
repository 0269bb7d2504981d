"""What the label ablation varies, read from ``label_variants.yaml``: one setting at a time around the default."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from experiments.cache.stages import Scale
from labeling.generator.settings.label_config import LabelConfig


@dataclass(frozen=True)
class Variant:
    """The default with some settings changed."""

    name: str
    changes: dict[str, Any]
    quick: bool = True
    """Not for the full scale only."""

    def config(self, seed: int) -> LabelConfig:
        """The settings."""
        return replace(LabelConfig(seed=seed), **self.changes)


@dataclass(frozen=True)
class Factor:
    """One question about the defaults, and the answers tried besides the default."""

    title: str
    settings: tuple[str, ...]
    """Fields of ``LabelConfig`` whose default it is about."""
    why: str
    """What the default does and what it is for."""
    variants: tuple[Variant, ...]


def _read_variant(scale: str = "quick", name: str | None = None, **changes: Any) -> Variant:
    setting, value = next(iter(changes.items()))
    return Variant(name or f"{setting} {value:g}", changes, scale == "quick")


_CONTENT = yaml.safe_load(Path(__file__).with_name("label_variants.yaml").read_text(encoding="utf-8"))
FACTORS = tuple(
    Factor(one["title"], tuple(one["settings"]), one["why"], tuple(_read_variant(**v) for v in one["variants"]))
    for one in _CONTENT["factors"]
)
NOT_STUDIED: dict[str, str] = _CONTENT["not_studied"]
"""Settings without a factor, and why."""


def variants(scale: Scale) -> list[tuple[Factor, Variant]]:
    """All variants of a scale."""
    return [
        (factor, one) for factor in FACTORS for one in factor.variants if one.quick or scale not in ("smoke", "quick")
    ]
