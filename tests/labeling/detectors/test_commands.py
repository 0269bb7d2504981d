"""``labeling.detect``, ``labeling.evaluate --detector`` and ``labeling.finetune`` on small data."""

import hashlib
import json
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from labeling.detect import main as detect
from labeling.detectors.data.annotated_pictures import read_pictures
from labeling.detectors.data.doubtful_labels import LEAST_CONFIDENCE
from labeling.detectors.networks.mask_rcnn import build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import load_network, save_network
from labeling.detectors.registry import load_detector
from labeling.evaluate import main as evaluate
from labeling.finetune import main as finetune
from labeling.generate import main as generate
from labeling.io.episodes import read_episode
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.training.config import RESULTS_FILE, WEIGHTS_FILE

from .toy_pictures import write_coco_folder

DETECTOR = '''
import numpy as np

CALLS = []

def find(rgb):
    """The chair, whole, and a vase that is not there."""
    CALLS.append(1)
    chair, vase = np.zeros(rgb.shape[:2], bool), np.zeros(rgb.shape[:2], bool)
    chair[2:10, 2:10] = True
    vase[0:3, 28:31] = True
    return [("chair", 0.9, chair), ("vase", 0.7, vase)]

def find_near(rgb, depth_m):
    """All that is nearer than two metres."""
    return [("chair", 0.9, (depth_m > 0) & (depth_m < 2))]

def fail(rgb):
    raise RuntimeError("out of film")
'''


@pytest.fixture
def detector(tmp_path, monkeypatch):
    name = f"finder_{tmp_path.name.replace('-', '_')}"
    (tmp_path / f"{name}.py").write_text(DETECTOR)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield name
    sys.modules.pop(name, None)


@pytest.fixture
def dataset(scene) -> Path:
    """Two episodes that no detector has looked at."""
    for name in ("one", "two"):
        scene.add_episode(name, detections=None)
    return scene.dataset


# detect --------------------------------------------------------------------------------------------------------------


def test_detections_lie_beside_the_frames_and_are_read_back(dataset, detector):
    assert detect([str(dataset), "--detector", f"{detector}:find"]) == 0
    episode = read_episode(dataset / "one")
    assert episode.detections is not None
    assert [(d.view_index, d.category, round(d.confidence, 6)) for d in episode.detections] == [
        (view, name, score) for view in (0, 1) for name, score in (("chair", 0.9), ("vase", 0.7))
    ]
    assert episode.detections[0].mask.sum() == 64
    assert episode.metadata["detector"] == f"{detector}:find"
    assert {"chair", "plant", "vase"} <= set(episode.categories)
    assert episode.ground_truth is not None
    assert {truth.category for truth in episode.ground_truth} == {"chair", "plant"}


def test_a_rerun_only_does_what_is_missing(dataset, detector, capsys):
    command = [str(dataset), "--detector", f"{detector}:find"]
    assert detect(command) == 0
    calls = sys.modules[detector].CALLS
    before = {path: path.read_bytes() for path in dataset.rglob("*.json")}
    assert detect(command) == 0
    assert "2 were done already" in capsys.readouterr().out
    assert len(calls) == 4
    # As if the process had been killed between writing the one file and the other.
    (dataset / "one" / "detections.json").unlink()
    assert detect(command) == 0
    assert len(calls) == 6
    assert {path: path.read_bytes() for path in dataset.rglob("*.json")} == before


def test_detections_of_others_are_left_alone_unless_told(scene, detector, capsys):
    scene.add_episode("one")
    before = (scene.dataset / "one" / "detections.json").read_bytes()
    command = [str(scene.dataset), "--detector", f"{detector}:find"]
    assert detect(command) == 2
    assert "--replace overwrites them" in capsys.readouterr().err
    assert (scene.dataset / "one" / "detections.json").read_bytes() == before
    assert detect([*command, "--replace"]) == 0
    assert (scene.dataset / "one" / "detections.json").read_bytes() != before


def test_a_full_disk_or_a_kill_while_results_are_replaced_loses_nothing(dataset, detector, monkeypatch):
    command = [str(dataset), "--detector", f"{detector}:find"]
    assert detect(command) == 0
    files = [dataset / "one" / name for name in ("detections.json", "episode.json")]
    before = [file.read_bytes() for file in files]
    other = [str(dataset), "--detector", f"{detector}:find_near"]

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_text", full)
        assert detect(other) == 2
    assert [file.read_bytes() for file in files] == before
    assert detect(other) == 0
    # Killed after the one file was written, before the other: whoever comes next replaces what was to be replaced.
    about = json.loads(files[1].read_text())
    about["detector_run"]["replaced_sha256"] = hashlib.sha256(before[0]).hexdigest()
    for again in (other, command):
        files[0].write_bytes(before[0])
        files[1].write_text(json.dumps(about))
        assert detect(again) == 0
    assert files[0].read_bytes() == before[0]
    # What was replaced, and somebody has put back since, is theirs.
    assert detect(other) == 0
    files[0].write_bytes(before[0])
    assert detect(other) == 2
    assert files[0].read_bytes() == before[0]


def test_views_that_no_detector_has_looked_at_are_told(dataset, detector, capsys):
    assert detect([str(dataset), "--detector", f"{detector}:find", "--every", "2"]) == 0
    assert f"labeling.generate {dataset} --every=2 --out LABELS" in capsys.readouterr().out
    assert read_episode(dataset / "one", RecordingConfig(every=2)).notes == ()
    (note,) = read_episode(dataset / "one").notes
    assert note.startswith("the detector has looked at 1 of these 2 views")


def test_detections_that_cannot_be_read_can_be_replaced(dataset, detector):
    (dataset / "one" / "detections.json").write_text("{ not JSON")
    assert detect([str(dataset), "--detector", f"{detector}:find"]) == 2
    assert detect([str(dataset), "--detector", f"{detector}:find", "--replace"]) == 0
    assert read_episode(dataset / "one").detections


def test_a_failing_detector_is_one_line_an_episode(dataset, detector, capsys):
    assert detect([str(dataset), "--detector", f"{detector}:fail"]) == 2
    error = capsys.readouterr().err
    assert f"detector {detector}:fail on rgb/000.png of one: RuntimeError: out of film" in error
    assert not list(dataset.rglob("detections.json"))


@pytest.mark.slow
def test_networks_write_detections_that_say_what_they_know(dataset, tmp_path):
    torch.manual_seed(0)
    network = build_network(NetworkSpec("compact", ("chair", "lamp")))
    torch.nn.init.ones_(network.roi_heads.mask_predictor.mask_fcn_logits.bias)  # else random masks are empty
    save_network(tmp_path / "run" / WEIGHTS_FILE, network)
    assert detect([str(dataset), "--detector", str(tmp_path / "run")]) == 0
    episode = read_episode(dataset / "two")
    assert episode.metadata["detector_categories"] == ["chair", "lamp"]
    found = load_detector(str(tmp_path / "run")).detect(episode.rgb)
    assert episode.detections is not None
    assert len(episode.detections) == sum(len(one.scores) for one in found)
    kept = [d.mask for d in episode.detections if d.view_index == 1]
    np.testing.assert_array_equal(kept[0], found[1].masks[0])


# evaluate ------------------------------------------------------------------------------------------------------------


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


# finetune ------------------------------------------------------------------------------------------------------------

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
