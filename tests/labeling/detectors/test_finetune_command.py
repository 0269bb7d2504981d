"""``labeling.finetune`` on small data."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from labeling.detectors.data.annotated_pictures import read_pictures
from labeling.detectors.data.doubtful_labels import LEAST_CONFIDENCE
from labeling.detectors.networks.mask_rcnn import build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import load_network, save_network
from labeling.detectors.registry import load_detector
from labeling.finetune import main as finetune
from labeling.training.config import RESULTS_FILE, WEIGHTS_FILE

from .toy_pictures import write_coco_folder

QUICK = [
    "--iterations", "2", "--batch-size", "1", "--validate-every", "1", "--warmup", "0", "--short-side-px", "64", "64",
    "--device", "cpu",
]  # fmt: skip


@pytest.fixture
def start(tmp_path) -> Path:
    torch.manual_seed(0)
    spec = NetworkSpec("compact", ("chair", "ball", "box"), short_side_px=(64, 320))
    save_network(tmp_path / "start" / WEIGHTS_FILE, build_network(spec))
    return tmp_path / "start"


@pytest.mark.slow
def test_finetuning_writes_a_detector_and_prints_what_changed(scene, start, tmp_path, capsys):
    scene.add_episode("one")
    scene.write_labels()
    photographs = tmp_path / "photographs"
    write_coco_folder(photographs / "train", 3)
    write_coco_folder(photographs / "val", 2, first_seed=9)
    out = tmp_path / "run"
    command = [str(scene.labels), "--detector", str(start), "--out", str(out), "--val", str(scene.dataset)]
    command += ["--replay", str(photographs), *QUICK]
    assert finetune(command) == 0
    printed = capsys.readouterr().out
    for text in ("has no name for plant: background", "AP in percent", "forgetting: AP50", "validation", f"{out}"):
        assert text in printed
    results = json.loads((out / RESULTS_FILE).read_text())
    assert results["iterations"] == 2
    assert set(results["after"]) == {"validation", "source pictures"}
    assert load_detector(str(out)).categories == ("chair", "ball", "box")
    assert list((out / "tensorboard").iterdir())
    before = (out / WEIGHTS_FILE).read_bytes()
    assert finetune(command) == 0
    assert "going on from step 2" in capsys.readouterr().out
    assert (out / WEIGHTS_FILE).read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("told", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.nightly)])
def test_a_finetuning_told_to_stop_loses_no_batch_and_says_how_to_go_on(
    scene, start, tmp_path, monkeypatch, capsys, told
):
    from labeling.detectors.finetuning.training import FinetuneTask

    scene.add_episode("one")
    scene.write_labels()
    command = [str(scene.labels), "--detector", str(start), *QUICK, "--iterations", "3", "--validate-every", "3"]
    losses = FinetuneTask.losses

    def told_in_step_1(self, batch, step):
        if step == 1:
            os.kill(os.getpid(), told)
        return losses(self, batch, step)

    assert finetune([*command, "--out", str(tmp_path / "whole")]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(FinetuneTask, "losses", told_in_step_1)
        assert finetune([*command, "--out", str(tmp_path / "told")]) == 128 + told
    assert "the same command goes on with what is missing" in capsys.readouterr().err
    assert finetune([*command, "--out", str(tmp_path / "told")]) == 0
    said = capsys.readouterr().out
    assert "going on from step 2" in said
    assert f"python -m labeling.evaluate EPISODES --detector {tmp_path / 'told'}" in said
    resumed, whole = (load_network(tmp_path / name / WEIGHTS_FILE).state_dict() for name in ("told", "whole"))
    assert all(torch.equal(value, whole[name]) for name, value in resumed.items())


@pytest.mark.slow
def test_several_label_sets_are_learnt_from_together(scene, start, tmp_path, capsys):
    scene.add_episode("one")
    scene.write_labels()
    photographs = write_coco_folder(tmp_path / "photographs", 3)
    command = ["--detector", str(start), "--out", str(tmp_path / "run"), *QUICK]
    assert finetune([str(scene.labels), str(photographs), *command]) == 0
    assert json.loads((tmp_path / "run" / RESULTS_FILE).read_text())["labels"] == f"{scene.labels}, {photographs}"
    from labeling.finetune import FinetuneCommand, read

    pictures, *_ = read(FinetuneCommand((scene.labels, photographs), Path("run")))
    assert pictures == [*read_pictures(scene.labels), *read_pictures(photographs)]
    capsys.readouterr()
    assert finetune([str(scene.labels), str(photographs), "--dataset", str(scene.dataset), *command]) == 2
    assert "pictures of one label set lie, but 2 were given" in capsys.readouterr().err
    assert finetune(command) == 2
    assert "nothing to learn from was given" in capsys.readouterr().err


@pytest.mark.slow
def test_new_categories_are_learnt_on_request(scene, start, tmp_path):
    scene.add_episode("one")
    scene.write_labels()
    command = [str(scene.labels), "--detector", str(start), "--out", str(tmp_path / "run"), "--new-categories", *QUICK]
    assert finetune(command) == 0
    assert load_detector(str(tmp_path / "run")).categories == ("chair", "ball", "box", "plant")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--detector", "yolo"), "unknown detector 'yolo'; known: compact"),
        (("--detector", "json:dumps"), "json:dumps cannot be trained here; these can: compact"),
        (("--val", "nowhere"), "nowhere: no such folder"),
        (("--least-confidence", "0.99"), "learnt from, in 2 pictures; --least-confidence 0.99 leaves out "),
        (("--least-confidence", "2"), "--least-confidence must lie in"),
        (("--learning-rate", "0"), "--learning-rate must be above 0"),
        (("--replay", "nowhere"), "nowhere: no such folder"),
    ],
)
def test_what_makes_no_sense_is_refused(scene, start, tmp_path, capsys, flags, message):
    scene.add_episode("one")
    scene.write_labels()
    command = [str(scene.labels), "--detector", str(start), "--out", str(tmp_path / "run"), *QUICK, *flags]
    assert finetune(command) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_empty_label_sets_and_strange_classes_are_refused(scene, tmp_path, capsys):
    save_network(tmp_path / "lamps" / WEIGHTS_FILE, build_network(NetworkSpec("compact", ("lamp",))))
    scene.add_episode("one")
    scene.write_labels(lambda truth: None)
    command = [str(scene.labels), "--detector", str(tmp_path / "lamps"), "--out", str(tmp_path / "run"), *QUICK]
    assert finetune(command) == 2
    assert capsys.readouterr().err.endswith("no label that could be learnt from, in 2 pictures\n")
    scene.write_labels()
    assert finetune(command) == 2
    assert "none of the categories there (chair, plant) is one that" in capsys.readouterr().err


def test_labels_below_the_least_confidence_are_background_to_learn_and_to_choose_by(scene):
    scene.add_episode("one")
    scene.write_labels(lambda truth: (truth.category, 0.3 if truth.category == "chair" else 0.8, truth.modal))
    from labeling.finetune import FinetuneCommand, read

    command = FinetuneCommand((scene.labels,), Path("run"), val=scene.labels)
    for least, expected in ((LEAST_CONFIDENCE, {"chair", "plant"}), (0.5, {"plant"})):
        learn, validation, *_ = read(replace(command, least_confidence=least))
        for pictures in (learn, validation):
            assert {one.category for picture in pictures for one in picture.annotations} == expected
            assert not any(one.ignore for picture in pictures for one in picture.annotations)
    assert command.least_confidence == LEAST_CONFIDENCE
