"""Calibration of detectors: labels of episodes alone and together, and what comes out is what labels are made with."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments.calibrate_labels import main
from experiments.calibration.label_samples import joined_samples, label_samples
from labeling.generator.calibration.detector_calibration import FOLDER, calibration_of
from labeling.generator.quality.label_quality import FEATURES
from labeling.io.episodes import write_episode

from ..labeling.synthetic_room import make_episode, pick

SCENES = {"room/3": ([0, 3, 6, 9], [1, 4, 7, 10]), "room/5": ([0, 2, 4, 6],)}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two visits to one scene, one to another."""
    folder = tmp_path_factory.mktemp("visits")
    number = 0
    for scene, visits in SCENES.items():
        whole = make_episode(int(scene[-1]), num_views=12, size=(90, 120), num_objects=4, wrong_class=0.0)
        for views in visits:
            metadata = {"world": "rooms", "scene": scene, "episode": number, "detector": "compact"}
            write_episode(folder / f"visit_{number}", replace(pick(whole, views), metadata=metadata))
            number += 1
    return folder


def test_a_scene_that_is_labelled_together_is_compared_with_the_truth_of_each_of_its_visits(dataset: Path) -> None:
    calibration = calibration_of("compact")
    alone, together = (label_samples([dataset], 0, calibration, kind) for kind in (False, True))
    for some in (alone, together):
        assert len(some.features) == len(some.iou) == len(some.scene) == len(some.masks) > 0
        assert set(some.scene) == set(SCENES)
        assert len(some.origins) == 3
        assert np.mean(some.iou) > 0.5  # each label lies on the views that it is of
    found = [some.features[:, list(FEATURES).index("agreeing_views")].max() for some in (alone, together)]
    assert found[1] > found[0]
    assert sorted({one.image for one in alone.truths}) == sorted({one.image for one in together.truths})
    both = joined_samples([alone, together])
    assert len(both.iou) == len(alone.iou) + len(together.iou)
    assert both.origins == alone.origins


@pytest.mark.slow
def test_the_model_of_objects_can_be_kept(dataset: Path, tmp_path: Path) -> None:
    places = ["--out", str(tmp_path), "--results", str(tmp_path / "figures.json")]
    checked = ["--check", str(dataset), "--picture", str(tmp_path / "trust.png")]
    assert main([str(dataset), "--keep-objects", *places, *checked]) == 0
    made, shipped = (json.loads((folder / "compact.json").read_text()) for folder in (tmp_path, FOLDER))
    assert made["objects"] == shipped["objects"]
    assert len(made["labels"]["gain"]) == len(FEATURES)
    assert made["fitted_to"]["objects"] == shipped["fitted_to"]["objects"]
    assert len(made["fitted_to"]["episodes"]) == 3
    figures = json.loads((tmp_path / "figures.json").read_text())
    for part in ("fitted_to", "held_out", "checked_on"):
        for kind in ("alone", "together"):
            found = figures[part][kind]
            low, high = found["intervals"]["ece"]
            assert 0 <= low <= high <= 1
            assert found["labels"] > 0
    assert (tmp_path / "trust.png").stat().st_size > 1000


@pytest.mark.slow
def test_a_calibration_is_measured_as_it_is(dataset: Path, tmp_path: Path) -> None:
    results, picture = tmp_path / "figures.json", tmp_path / "trust.png"
    results.write_text(json.dumps({"held_out": {}, "checked_on": {}}))
    where = ["--out", str(tmp_path / "fits"), "--results", str(results), "--picture", str(picture)]
    assert main(["--check", str(dataset), *where]) == 0
    assert not (tmp_path / "fits").exists()
    figures = json.loads(results.read_text())
    assert list(figures["checked_on"]) == ["alone", "together"]
    assert figures["held_out"] == {}
    assert figures["checked_with"]["git_commit"]
    assert picture.stat().st_size > 1000


def test_there_must_be_something_to_fit_to_or_to_measure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert "at least one dataset" in capsys.readouterr().err
    room = make_episode(3, num_views=3, size=(60, 80), num_objects=2)
    write_episode(tmp_path / "data" / "0", replace(room, metadata={"detector": "somebody's"}))
    assert main(["--check", str(tmp_path / "data")]) == 2
    assert "somebody's has no calibration that could be measured" in capsys.readouterr().err


def test_a_detector_without_a_calibration_has_no_model_of_objects_to_keep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room = make_episode(3, num_views=3, size=(60, 80), num_objects=2)
    write_episode(tmp_path / "data" / "0", replace(room, metadata={"detector": "somebody's"}))
    assert main([str(tmp_path / "data"), "--keep-objects", "--out", str(tmp_path)]) == 2
    assert "no calibration whose model of objects could be kept" in capsys.readouterr().err
