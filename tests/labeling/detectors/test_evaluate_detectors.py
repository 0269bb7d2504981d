"""``labeling.evaluate`` of detectors: detections beside the frames, and ``--detector``."""

import json

import pytest
import torch

from labeling.detect import main as detect
from labeling.detectors.networks.mask_rcnn import build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import save_network
from labeling.evaluate import main as evaluate
from labeling.generate import main as generate
from labeling.training.config import WEIGHTS_FILE


def test_a_detector_scores_the_same_beside_the_frames_and_run_anew(dataset, detector, tmp_path):
    name = f"{detector}:find"
    assert evaluate([str(dataset), "--detector", name, "--metrics", str(tmp_path / "anew.json")]) == 0
    assert detect([str(dataset), "--detector", name]) == 0
    assert evaluate([str(dataset), "--metrics", str(tmp_path / "beside.json")]) == 0
    anew, beside = (json.loads((tmp_path / file).read_text())["detector"] for file in ("anew.json", "beside.json"))
    for metrics in (anew, beside):
        assert metrics["per_class"]["chair"]["mask_ap50"] == pytest.approx(1.0)
        assert metrics["per_class"]["plant"]["mask_ap50"] == 0.0
    assert anew["mask_ap50"] == beside["mask_ap50"] == pytest.approx(0.5)


def test_a_detector_that_is_scored_sees_depth_as_it_does_when_it_detects(dataset, detector, tmp_path):
    name = f"{detector}:find_near"
    for flags, views in ((("--every", "2"), 2), ((), 4)):
        out = tmp_path / f"{views}.json"
        assert evaluate([str(dataset), "--detector", name, "--metrics", str(out), *flags]) == 0
        counts = json.loads(out.read_text())["counts"]
        assert (counts["views"], counts["detections"]) == (views, views)


def test_a_detector_is_scored_on_a_label_set_wherever_its_pictures_lie(scene, detector, tmp_path, capsys):
    scene.add_episode("one")
    scene.write_labels()
    command = [str(scene.labels), "--detector", f"{detector}:find"]
    scene.dataset.rename(tmp_path / "moved")
    assert evaluate(command) == 2
    assert evaluate([*command, "--dataset", str(tmp_path / "moved")]) == 0
    assert evaluate([*command, "--every", "2"]) == 2
    assert "holds no episodes, and how these are read" in capsys.readouterr().err
    assert evaluate([str(tmp_path / "moved"), "--dataset", str(tmp_path / "moved")]) == 2
    assert "holds episodes itself" in capsys.readouterr().err


@pytest.mark.parametrize("about", [{"detector": {"name": "yolo"}}, {"detector_categories": [{"id": 1}]}])
def test_odd_words_about_a_detector_are_no_traceback(scene, capsys, about):
    scene.add_episode("one", metadata=about)
    is_odd = "detector_categories" in about
    assert evaluate([str(scene.dataset)]) == (2 if is_odd else 0)
    assert ("detector_categories: must be a list of names" in capsys.readouterr().err) == is_odd


def test_a_detector_scores_beside_the_frames_as_it_does_in_a_label_set(scene, detector, tmp_path):
    scene.add_episode("one")
    scene.write_labels()
    assert evaluate([str(scene.labels)]) == 0
    assert evaluate([str(scene.dataset), "--metrics", str(tmp_path / "m.json")]) == 0
    alone = json.loads((tmp_path / "m.json").read_text())["detector"]
    assert alone == json.loads((scene.labels / "metrics.json").read_text())["detector"]


def test_episodes_are_scored_as_the_options_of_recordings_say(scene, tmp_path, capsys):
    scene.add_episode("one")
    scene.write_labels()
    assert evaluate([str(scene.dataset), "--every", "2", "--metrics", str(tmp_path / "m.json")]) == 0
    assert json.loads((tmp_path / "m.json").read_text())["counts"]["views"] == 1
    assert evaluate([str(scene.dataset), "--layout", "tum"]) == 2
    assert evaluate([str(scene.labels), "--every", "2"]) == 2
    assert "how its recordings are read, a label set says itself" in capsys.readouterr().err


def test_evaluation_leaves_out_what_the_detector_of_the_labels_was_never_taught(scene, tmp_path):
    torch.manual_seed(0)
    network = build_network(NetworkSpec("compact", ("chair", "lamp")))
    torch.nn.init.ones_(network.roi_heads.mask_predictor.mask_fcn_logits.bias)
    save_network(tmp_path / "run" / WEIGHTS_FILE, network)
    # The episode's own detector knew plants; the one that the labels come from does not.
    scene.add_episode("one", metadata={"detector_categories": ["chair", "plant"]})
    generate([str(scene.dataset), "--detector", str(tmp_path / "run"), "--out", str(scene.labels)])
    assert evaluate([str(scene.labels)]) == 0
    metrics = json.loads((scene.labels / "metrics.json").read_text())
    assert metrics["counts"]["ground_truth_instances"] == 2
    assert any("has no name for: plant" in note for note in metrics["notes"])


def test_episodes_without_detections_or_truth_are_told_what_to_do(scene, capsys):
    scene.add_episode("one", detections=None)
    assert evaluate([str(scene.dataset)]) == 2
    assert "has no detections.json; give --detector NAME" in capsys.readouterr().err
    scene.add_episode("one", ground_truth=None)
    assert evaluate([str(scene.dataset)]) == 2
    assert "has no ground_truth.json to compare with" in capsys.readouterr().err


def test_a_detector_that_knows_none_of_the_categories_has_no_score(dataset, tmp_path, capsys):
    save_network(tmp_path / "run" / WEIGHTS_FILE, build_network(NetworkSpec("compact", ("lamp",))))
    assert evaluate([str(dataset), "--detector", str(tmp_path / "run")]) == 2
    assert "holds no object of a category that" in capsys.readouterr().err
