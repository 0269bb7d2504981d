"""``labeling.detect`` on small recordings."""

import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from labeling.detect import main as detect
from labeling.detectors.networks.mask_rcnn import build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import save_network
from labeling.detectors.registry import load_detector
from labeling.formats.atomic import write_png
from labeling.io.episodes import read_episode
from labeling.io.recordings.pictures import read_colour
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.training.config import WEIGHTS_FILE


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


def test_a_recording_that_has_changed_is_looked_at_anew(dataset, detector, capsys):
    command = [str(dataset), "--detector", f"{detector}:find"]
    assert detect(command) == 0
    (dataset / "one" / "detections_3d.json").write_text("{}")
    picture = dataset / "one" / "rgb" / "001.png"
    write_png(picture, np.zeros_like(read_colour(picture)))
    capsys.readouterr()
    assert detect(command) == 0
    assert "of 1 episodes; 1 were done already" in capsys.readouterr().out
    assert len(sys.modules[detector].CALLS) == 6


def test_an_episode_that_cannot_be_written_to_does_not_stop_the_others(dataset, detector, monkeypatch, capsys):
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).name != "one")  # root may write everywhere
    assert detect([str(dataset), "--detector", f"{detector}:find"]) == 2
    error = capsys.readouterr().err
    assert f"error: {dataset / 'one'}: cannot be written to; change its permissions" in error
    assert "1 of 2 episodes failed" in error
    assert len(sys.modules[detector].CALLS) == 2
    assert (dataset / "two" / "detections.json").is_file()


def test_an_episode_that_the_system_refuses_does_not_stop_the_others(dataset, detector, monkeypatch, capsys):
    write = Path.write_text

    def refuse(path: Path, *given: Any, **more: Any) -> int:
        if path.parent.name == "one":
            raise PermissionError(13, "Permission denied", str(path))
        return write(path, *given, **more)

    monkeypatch.setattr(Path, "write_text", refuse)
    assert detect([str(dataset), "--detector", f"{detector}:find"]) == 2
    error = capsys.readouterr().err
    assert f"error: {dataset / 'one'}: cannot be read or written (" in error
    assert "1 of 2 episodes failed" in error
    assert (dataset / "two" / "detections.json").is_file()


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
