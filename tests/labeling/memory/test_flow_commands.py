"""Flow on a memory from the command line: trained, resumed, what moves found, refused."""

import json
import os
import signal
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from PIL import Image

from labeling import detect3d, imagine, train_flow, train_memory
from labeling.core.detector import DetectorError
from labeling.formats.checked_json import read_json
from labeling.io.coco import read_valid_box_3d
from labeling.io.episodes import read_episode, write_episode
from labeling.memory.flow.flow_detector import SPEC_KEY, load_flow_net, load_moving_detector, save_flow_net
from labeling.memory.flow.flow_net import FlowNet
from labeling.memory.flow.flow_training import FlowTask
from labeling.memory.networks.weights import load_memory
from labeling.memory.settings.flow_settings import FlowSpec
from labeling.training.config import WEIGHTS_FILE
from labeling.training.weights import save_weights

from .orbits import orbit_episode, orbit_pose
from .test_flow import MEMORY, moving_episode

SIZE = ("--voxels", "16", "16", "8", "--voxel-m", "0.3", "--channels", "8", "--picture", "32", "32")
QUICK = ("--iterations", "4", "--validate-every", "2", "--batch-size", "1", "--width", "8", "--device", "cpu")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    middle = np.array([0.0, 0.0, 0.7])
    for seed in (1, 2):
        poses = [orbit_pose(0.3 * view, 0.4, 2.0, middle) for view in range(4)]
        write_episode(folder / f"toys_{seed}", orbit_episode(seed, poses))
    return folder


def trained_memory(recorded: Path, out: Path, model: str) -> Path:
    options = ("--model", model, *SIZE, "--planes", "8", "--width", "8", "--inputs", "2")
    assert train_memory.main(
        [str(recorded), "--out", str(out), *options, "--iterations", "2", "--validate-every", "2", "--device", "cpu"]
    ) == 0  # fmt: skip
    return out


@pytest.fixture(scope="module")
def memory(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return trained_memory(recorded, tmp_path_factory.mktemp("memory") / "run", "cn3d")


@pytest.fixture(scope="module")
def command(recorded: Path, memory: Path) -> list[str]:
    return [str(recorded), "--memory", str(memory), "--val", str(recorded), *QUICK]


@pytest.fixture(scope="module")
def trained(command: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained") / "run"
    assert train_flow.main([*command, "--out", str(out)]) == 0
    return out


@pytest.fixture
def moving(tmp_path: Path) -> Path:
    write_episode(tmp_path / "moving" / "one", moving_episode())
    return tmp_path / "moving"


def refused(capsys, main, *arguments: object) -> str:
    assert main(list(map(str, arguments))) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("error: ")
    return error.splitlines()[-1]


@pytest.mark.slow
def test_training_says_what_it_learnt_and_leaves_the_memory_as_it_is(command, memory, trained, capsys):
    results = json.loads((trained / "results.json").read_text())
    assert set(results["validation"]) >= {"f1", "moving_m", "standing_m"}
    network, known = load_flow_net(trained / WEIGHTS_FILE), load_memory(memory).state_dict()
    assert all(torch.equal(value, network.memory.state_dict()[name]) for name, value in known.items())
    assert (trained / "history.json").is_file()
    assert train_flow.main([*command, "--out", str(trained)]) == 0
    said = capsys.readouterr().out
    assert "6 pairs of views of 2 episodes to learn from, 6 to choose by, 0 of episodes in which things move" in said
    assert "going on from step 4" in said


@pytest.mark.slow
def test_a_run_told_to_stop_loses_no_batch_and_ends_like_one_that_was_not(command, trained, tmp_path, monkeypatch):
    out, losses = tmp_path / "run", FlowTask.losses

    def told(self, batch, step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return losses(self, batch, step)

    with monkeypatch.context() as patch:
        patch.setattr(FlowTask, "losses", told)
        assert train_flow.main([*command, "--out", str(out)]) == 128 + signal.SIGTERM
    assert train_flow.main([*command, "--out", str(out)]) == 0
    resumed, whole = (load_flow_net(one / WEIGHTS_FILE).state_dict() for one in (out, trained))
    assert all(torch.equal(value, whole[name]) for name, value in resumed.items())
    histories = [json.loads((one / "history.json").read_text()) for one in (out, trained)]
    assert histories[0] == histories[1]


@pytest.mark.slow
def test_recordings_in_which_things_move_are_learnt_from_too(recorded, tmp_path, moving, capsys):
    grnn = trained_memory(recorded, tmp_path / "grnn", "grnn")
    options = ("--memory", str(grnn), "--moving", str(moving), *QUICK)
    assert train_flow.main([str(recorded), "--out", str(tmp_path / "run"), *options]) == 0
    assert "1 of episodes in which things move" in capsys.readouterr().out


@pytest.mark.slow
def test_a_supervised_rival_learns_from_what_really_moves(memory, moving, recorded, tmp_path, capsys):
    options = ("--memory", str(memory), "--supervised", "--val", str(moving), "--out", str(tmp_path / "run"), *QUICK)
    assert train_flow.main([str(moving), *options]) == 0
    assert "1 pairs of views of 1 episodes to learn from, 1 to choose by" in capsys.readouterr().out
    load_moving_detector(tmp_path / "run")
    error = refused(capsys, train_flow.main, recorded, *options)
    assert "has no motion.json: its scene flow is not known" in error


@pytest.mark.slow
def test_what_moves_is_found_once(moving, trained, capsys):
    assert detect3d.main([str(moving), "--detector", str(trained)]) == 0
    file = moving / "one" / "detections_3d.json"
    for one in read_json(file).list_of("detections"):
        assert one.text("category") == "moving"
        assert one.get("views").value == [0, 1]
        assert 0 <= one.number("score") <= 1
        assert np.all(read_valid_box_3d(one.get("box_3d")).extent_m > 0)
        assert one.array("displacement_m", (3,)).shape == (3,)
    assert read_json(file).text("detector") == str(trained)
    capsys.readouterr()
    assert detect3d.main([str(moving), "--detector", str(trained)]) == 0
    assert "0 boxes in 0 episodes; 1 were done already" in capsys.readouterr().out


@pytest.mark.slow
def test_flow_is_drawn_from_above_and_filmed(recorded, trained, moving, tmp_path, monkeypatch, capsys):
    out = tmp_path / "pictures"
    assert imagine.main([str(trained), str(recorded / "toys_1"), "--out", str(out), "--views", "0", "2"]) == 0
    said = capsys.readouterr().out
    assert str(out / "toys_1_flow.png") in said
    picture = cv2.imread(str(out / "toys_1_flow.png"))
    assert picture is not None
    assert picture.shape[:2] == (3 * (256 + 18), 2 * 256 + 4)
    shown = cv2.resize(picture[18:274, :256, ::-1], (48, 48), interpolation=cv2.INTER_AREA).astype(int)
    expected = cv2.resize(read_episode(recorded / "toys_1").rgb[0], (48, 48), interpolation=cv2.INTER_AREA)
    assert np.abs(shown - expected).mean() < 10
    with Image.open(out / "toys_1_flow.gif") as film:
        assert film.n_frames == 3  # type: ignore[attr-defined]
    assert imagine.main([str(trained), str(moving / "one"), "--out", str(out)]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(imagine, "FILMED_PAIRS", 2)
        assert imagine.main([str(trained), str(recorded / "toys_1"), "--out", str(out)]) == 0
    with Image.open(out / "toys_1_flow.gif") as film:
        assert film.n_frames == 2  # type: ignore[attr-defined]
    error = refused(capsys, imagine.main, trained, recorded / "toys_1", "--out", out, "--views", 3)
    assert "view 3 has no view after it to compare; those that do are 0, 1, 2" in error
    error = refused(capsys, imagine.main, trained, recorded / "toys_1", "--out", out, "--inputs", 1)
    assert "give the first ones with --views, no --inputs" in error


@pytest.mark.slow
def test_the_detector_gives_every_pair_of_views(recorded, trained):
    detector, episode = load_moving_detector(trained, "cpu"), read_episode(recorded / "toys_1")
    pairs = [pair.view_index for pair, _ in detector.find(episode.name, episode)]
    assert pairs == [(0, 1), (1, 2), (2, 3)]


@pytest.mark.slow
def test_wrong_input_is_refused_in_one_sentence(recorded, memory, trained, tmp_path, moving, capsys):
    out = tmp_path / "out"
    for options, why in (
        (("--memory", memory, "--pieces", "0"), "--pieces must be above 0"),
        (("--memory", memory, "--furthest-m", "-1"), "--furthest-m must be above 0"),
        (("--memory", memory, "--width", "10"), "a multiple of 4 up to 1024, not 10"),
        (("--memory", tmp_path), "give the folder of a labeling.train_memory run"),
        (("--memory", memory, "--moving", tmp_path / "nowhere"), "nowhere"),
    ):
        assert why in refused(capsys, train_flow.main, recorded, "--out", out, *options)
    tower = trained_memory(recorded, tmp_path / "tower", "tower")
    assert "which tower does not have; take grnn or cn3d" in refused(
        capsys, train_flow.main, recorded, "--memory", tower, "--out", out, *QUICK
    )
    assert not out.exists()
    assert "holds a run with other data or settings" in refused(
        capsys, train_flow.main, recorded, "--memory", memory, "--val", recorded, "--out", trained, *QUICK, "--seed", 3
    )
    for options, why in ((("--boxes", "compact"), "leave out --boxes"), (("--views", "2"), "--views is for detectors")):
        assert why in refused(capsys, detect3d.main, moving, "--detector", trained, *options)


@pytest.mark.slow
def test_episodes_whose_views_have_nothing_in_common_are_refused(trained, memory, tmp_path, capsys):
    middle = np.array([0.0, 0.0, 0.7])
    apart = orbit_episode(1, [orbit_pose(2.0 * view, 0.4, 2.0, middle) for view in range(3)])
    write_episode(tmp_path / "apart" / "one", apart)
    assert "no two of its 3 views follow each other" in refused(
        capsys, train_flow.main, tmp_path / "apart", "--memory", memory, "--out", tmp_path / "run", *QUICK
    )
    assert detect3d.main([str(tmp_path / "apart"), "--detector", str(trained)]) == 2
    assert "no two of its 3 views follow each other" in capsys.readouterr().err


def test_weights_are_read_as_they_were_written_and_malformed_ones_refused(tmp_path):
    torch.manual_seed(0)
    network, path = FlowNet(FlowSpec(MEMORY, 8)), tmp_path / WEIGHTS_FILE
    save_flow_net(path, network, {"episodes": "made up"})
    again = load_flow_net(path)
    assert again.spec == network.spec
    assert all(torch.equal(value, network.state_dict()[name]) for name, value in again.state_dict().items())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DetectorError, match="is damaged or no safetensors file"):
        load_flow_net(path)
    for spec, why in (
        ("{", "the description of its network is damaged"),
        ('{"width": 3}', "a multiple of 4 up to 1024, not 3"),
        ('{"memory": {"model": "tower"}}', "which tower does not have"),
        ("{}", "its tensors are not those of a network that tells flow on a memory of kind cn3d"),
    ):
        save_weights(path, network, {SPEC_KEY: spec})
        with pytest.raises(DetectorError, match=why):
            load_flow_net(path)
    save_weights(path, network, {"memory_boxes": "{}"})
    with pytest.raises(DetectorError, match=r"does not say of which network; make it with labeling\.train_flow"):
        load_flow_net(path)
