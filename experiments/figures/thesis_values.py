"""What the thesis reports, in points of AP: ``thesis_values.yaml``."""

from pathlib import Path

import yaml

_CONTENT = yaml.safe_load(Path(__file__).with_name("thesis_values.yaml").read_text(encoding="utf-8"))
MEANS: dict[str, dict[str, dict[str, float]]] = _CONTENT["means"]
"""Over all categories, by table, row and figure ("ap50", "ap30")."""
PER_CLASS: dict[str, dict[str, dict[str, dict[str, float]]]] = _CONTENT["per_class"]
"""By table, row, figure and category."""
BOXES_3D: dict[str, float] = _CONTENT["boxes_3d"]
"""AP of 3-D boxes at .25, streets, by row."""


def of_category(table: str, row: str, figure: str, category: str) -> float | None:
    """What the thesis reports of one category, if anything."""
    return PER_CLASS.get(table, {}).get(row, {}).get(figure, {}).get(category)
