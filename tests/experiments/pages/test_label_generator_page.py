"""The page about the label generator's settings tells which defaults are others since they were measured."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from experiments.pages.label_generator import page
from labeling.generator.settings.label_config import LabelConfig

COMMITTED = Path(__file__).parents[3] / "experiments" / "results" / "label_ablation.json"


@pytest.fixture
def ablation() -> dict[str, Any]:
    content = json.loads(COMMITTED.read_text(encoding="utf-8"))
    settings = asdict(LabelConfig())
    content["default"] = {name: settings.get(name, value) for name, value in content["default"].items()}
    return content


def test_a_default_that_has_changed_stands_beside_what_it_is_now(ablation: dict[str, Any]) -> None:
    assert "(now" not in page(ablation, None)
    ablation["default"]["min_confidence"] = 0.25
    assert f"`min_confidence = 0.25` (now `{LabelConfig().min_confidence}`)" in page(ablation, None)
