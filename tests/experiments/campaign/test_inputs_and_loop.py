"""Files as others write them are what they should be before they are spoilt; loops that are killed are counted."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from experiments.campaign import loop
from experiments.campaign.damage import damage
from experiments.campaign.foreign_inputs import BOXES_PX, make_furniture, make_onnx, make_outlines
from experiments.campaign.loop import Loop
from experiments.campaign.trial import run_trial
from labeling.detectors.registry import load_detector
from labeling.generate import main as generate
from labeling.io.episodes import write_episode
from sbm_gym.assets.catalog.library import Home3dLibrary

from ...labeling.synthetic_room import make_episode


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    episode = folder / "episodes" / "0000"
    write_episode(episode, make_episode(0, num_views=3, size=(48, 64), num_objects=2))
    truths = json.loads((episode / "ground_truth.json").read_text())["annotations"]
    found = [{name: one[name] for name in ("image_id", "category_id", "segmentation")} for one in truths]
    (episode / "detections.json").write_text(json.dumps([{**one, "score": 0.95} for one in found]))
    return folder


def test_the_exported_network_finds_its_boxes(inputs: Path, tmp_path: Path) -> None:
    make_onnx(tmp_path, inputs)
    (found,) = load_detector(f"onnx:{tmp_path / 'model.onnx'}").detect(np.zeros((1, 64, 64, 3), np.uint8))
    assert found.categories == ("chair", "couch")
    np.testing.assert_allclose(found.boxes_xyxy, np.array(BOXES_PX), atol=1e-3)


def test_the_furniture_library_has_two_models(tmp_path: Path) -> None:
    make_furniture(tmp_path, tmp_path)
    library = Home3dLibrary([tmp_path / "library.sh3f"], tmp_path / "cache")
    cards = library.cards()
    assert {card.category for card in cards} == {"chair", "table"}
    assert [library.load(card).num_triangles for card in cards] == [12, 12]


def test_outlines_and_results_label_the_episode(inputs: Path, tmp_path: Path) -> None:
    make_outlines(tmp_path, inputs)
    episode = str(tmp_path / "episodes" / "0000")
    for option, file in (("--annotations", "outlines.json"), ("--detections", "results.json")):
        out = tmp_path / file.removesuffix(".json")
        assert generate([episode, option, str(tmp_path / file), "--out", str(out)]) == 0
        assert json.loads((out / "instances_modal.json").read_text())["annotations"]


def test_one_file_of_an_archive_is_spoilt_and_the_archive_stays_one(tmp_path: Path) -> None:
    make_furniture(tmp_path, tmp_path)
    file = tmp_path / "library.sh3f"
    whole, spoilt = file.read_bytes(), 0
    for seed in range(60):
        if file.is_dir():
            file.rmdir()
        file.unlink(missing_ok=True)  # a pipe or a link, perhaps
        file.write_bytes(whole)
        done = damage(tmp_path, ["library.sh3f"], np.random.default_rng(seed))["library.sh3f"]
        if ": " in done and zipfile.is_zipfile(file):
            with zipfile.ZipFile(file) as archive:
                assert archive.testzip() is None
            spoilt += 1
    assert spoilt > 20


def test_variables_hold_for_the_trial_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SBM_CAMPAIGN", "before")
    out = tmp_path / "results" / "out"
    out.parent.mkdir()
    faulty = "tests.experiments.campaign.spoilt_commands"
    arguments = ["tells", str(tmp_path), str(out)]
    trial = run_trial(faulty, arguments, tmp_path, out, {"SBM_CAMPAIGN": "meanwhile"})
    assert "meanwhile" in trial.told
    assert os.environ["SBM_CAMPAIGN"] == "before"


PROGRAM = """
import json, sys, time
from pathlib import Path
folder, fault = Path(sys.argv[1]), sys.argv[2]
folder.mkdir(parents=True, exist_ok=True)
done = len(list(folder.glob("part*")))
for part in range(done, 3):
    time.sleep(0.4)
    (folder / f"part{part}").write_text("")
if fault == "refuses" and done:
    sys.exit(2)
(folder / "results").mkdir(exist_ok=True)
figures = {"made_on": time.time(), "rounds": 3 + (done if fault == "forgets" else 0)}
(folder / "results" / "never_ending.json").write_text(json.dumps(figures))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "outcome"), [("none", "survived"), ("forgets", "other figures"), ("refuses", "cannot go on")]
)
def test_a_loop_is_killed_until_it_is_done(
    fault: str, outcome: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(*_: object) -> "subprocess.Popen[str]":
        command = [sys.executable, "-c", PROGRAM, str(tmp_path / "loop"), fault]
        return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)

    monkeypatch.setattr(loop, "start", start)
    monkeypatch.setattr(loop, "LEAST_S", 0.6)
    monkeypatch.setattr(loop, "MOST_S", 0.7)
    found = Loop(tmp_path / "loop").disturbed(np.random.default_rng(0))
    assert found.outcome == outcome
    assert 0 < found.kills < 20 or outcome == "cannot go on"
