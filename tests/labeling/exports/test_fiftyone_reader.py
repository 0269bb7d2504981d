"""FiftyOne's own reader finds in a dataset what the label set says. It is installed apart: it needs other versions."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from labeling.convert import main
from labeling.io.labelled_views import LabelledView

READER = Path(__file__).with_name("fiftyone_reader.py")
NEEDS = ("fiftyone==1.22.1", "mongomock==4.3.0")


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An interpreter with FiftyOne."""
    home = tmp_path_factory.mktemp("fiftyone_reader") / "venv"
    subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)
    subprocess.run([str(home / "bin" / "pip"), "install", "-q", *NEEDS], check=True)
    return home / "bin" / "python"


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("kind", "field", "with_masks"),
    [("FiftyOneDataset", "pseudo_labels", True), ("FiftyOneImageDetectionDataset", "ground_truth", False)],
)
def test_fiftyone_reads_what_the_labels_say(
    kind: str, field: str, with_masks: bool, python: Path, labels: Path, views: list[LabelledView], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    assert main([str(labels), "--to", "fiftyone", "--out", str(out)]) == 0
    done = subprocess.run([str(python), str(READER), str(out), kind, field], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    [line] = [one for one in done.stdout.splitlines() if one.startswith("SAMPLES ")]
    samples = json.loads(line.removeprefix("SAMPLES "))
    assert samples.keys() == {f"{view.name}.png" for view in views}
    for view in views:
        rows, columns = view.rgb.shape[:2]
        for one, label in zip(samples[f"{view.name}.png"], view.labels, strict=True):
            assert (one["label"], one["confidence"], one["index"]) == (
                label.category,
                label.confidence,
                label.instance_id,
            )
            left, top, width, height = np.array(one["bounding_box"]) * [columns, rows, columns, rows]
            there = np.nonzero(label.mask)
            np.testing.assert_allclose([top, left], [axis.min() for axis in there], atol=1e-6)
            np.testing.assert_allclose([top + height, left + width], [axis.max() + 1 for axis in there], atol=1e-6)
            if with_masks:
                inside = label.mask[round(top) : round(top + height), round(left) : round(left + width)]
                np.testing.assert_array_equal(np.array(one["mask"], bool), inside)
