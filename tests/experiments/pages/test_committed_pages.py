"""The committed pages and pictures are what the committed results give."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.pages import (
    benchmarks,
    detector_labels,
    fine_tuning,
    label_generator,
    moving_labels,
    results,
    robustness,
    sensor_noise,
)
from experiments.pages.markdown import write_page
from experiments.pages.memory import boxes, moving_objects, view_prediction
from experiments.pages.policies import results as policies

ROOT = Path(__file__).resolve().parents[3]
DOCS = ROOT / "docs"


@pytest.mark.slow
@pytest.mark.parametrize(
    "module",
    [
        results,
        policies,
        fine_tuning,
        label_generator,
        benchmarks,
        sensor_noise,
        robustness,
        detector_labels,
        moving_labels,
        view_prediction,
        boxes,
        moving_objects,
    ],
)
def test_pages_and_pictures_are_those_of_the_results(module, tmp_path: Path) -> None:
    name = module.__name__.removeprefix("experiments.pages.")
    page, *pictures = write_page(name, ROOT / "experiments" / "results", tmp_path)
    text = (DOCS / module.PAGE).read_text(encoding="utf-8")
    assert page.read_text(encoding="utf-8") == text
    for picture in pictures:
        committed = DOCS / picture.relative_to(tmp_path)
        ours, theirs = (np.asarray(Image.open(file).convert("RGB"), int) for file in (picture, committed))
        assert ours.shape == theirs.shape, picture.name
        assert np.abs(ours - theirs).max() <= 1, picture.name
    shown = re.findall(r"\]\((pictures/[^)]*)\)", text)
    assert len(shown) >= len(pictures)
    for picture in shown:
        assert (DOCS / picture).is_file(), picture
