"""Boxes in a memory from the command line: trained, resumed, found, refused."""

import json
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
import torch

from labeling import detect3d, train3d, train_memory
from labeling.core.detector import DetectorError
from labeling.core.errors import UsageError
from labeling.formats.checked_json import read_json
from labeling.generate import main as generate
from labeling.io.coco import read_valid_box_3d
from labeling.io.episodes import read_episode, write_episode
from labeling.memory.boxes.box_detector import SPEC_KEY, load_box_net, load_memory_detector, save_box_net
from labeling.memory.boxes.box_net import BoxNet
from labeling.memory.boxes.box_training import BoxTask
from labeling.memory.boxes.labelled_scenes import read_labelled_scenes
from labeling.memory.networks.weights import MEMORY_FILE, build_memory, load_memory, save_memory
from labeling.memory.settings.box_settings import BoxSpec
from labeling.training.config import WEIGHTS_FILE
from labeling.training.weights import save_weights

from ..detectors3d.boxed_rooms import SIDES, boxed_room, known_of
from .test_boxes import TINY

SIZE = ("--voxels", "16", "16", "8", "--voxel-m", "0.3", "--channels", "8", "--picture", "32", "32")
QUICK = ("--iterations", "4", "--validate-every", "2", "--views", "2", "--device", "cpu")
NEW = ("--memory", "cn3d", *SIZE, *QUICK)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    for seed in (1, 2):
        write_episode(folder / f"boxed_{seed}", boxed_room(seed))
    return folder


@pytest.fixture(scope="module")
def labels(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("labels") / "set"
    assert generate([str(recorded), "--out", str(out), "--workers", "1"]) == 0
    return out


@pytest.fixture(scope="module")
def trained(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained") / "run"
    assert train3d.main([str(recorded), "--val", str(recorded), "--out", str(out), *NEW]) == 0
    return out


@pytest.fixture
def episodes(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "episodes"))


def refused(capsys, main, *arguments: object) -> str:
    assert main(list(map(str, arguments))) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("error: ")
    return error.splitlines()[-1]


@pytest.mark.slow
def test_training_says_what_it_learnt_and_where_it_is(recorded, trained, capsys):
    results = json.loads((trained / "results.json").read_text())
    assert results["memory"] == "cn3d"
    assert results["categories"] == sorted(SIDES)
    assert set(results["validation"]) == {"ap25", "ap50", "ap", "objects"}
    assert train3d.main([str(recorded), "--val", str(recorded), "--out", str(trained), *NEW]) == 0
    said = capsys.readouterr().out
    assert "2 episodes to learn from: crate, locker; 2 to choose by" in said
    assert "going on from step 4" in said
    assert f"detector: {trained}" in said


@pytest.mark.slow
def test_labels_are_learnt_from_as_ground_truth_is(labels, recorded, tmp_path):
    ours, _ = read_labelled_scenes([labels], TINY)
    truths, _ = read_labelled_scenes([recorded], TINY)
    assert [one.scene.name for one in ours] == [one.scene.name for one in truths]
    for scene, true in zip(ours, truths, strict=True):
        for one in scene.objects:
            nearest = min(true.objects, key=lambda other: np.linalg.norm(other.box.centre_m - one.box.centre_m))
            assert np.linalg.norm(nearest.box.centre_m - one.box.centre_m) < 0.4
            assert 0 < one.weight <= 1
            assert one.shown_by.any()
    assert train3d.main([str(labels), "--out", str(tmp_path / "run"), *NEW]) == 0


@pytest.mark.slow
def test_ground_truth_is_read_as_it_is(recorded):
    scenes, notes = read_labelled_scenes([recorded], TINY)
    assert not notes
    for one in scenes:
        episode = read_episode(recorded / one.scene.name)
        known = {truth.instance_id: (truth.category, box) for truth, box in known_of(episode)}
        assert sorted(known.values(), key=lambda other: tuple(other[1].centre_m))[0][0] in SIDES
        assert len(one.objects) == len(known)
        pixels = episode.rgb[0, :, :, 0].size
        for number, thing in zip(known, one.objects, strict=True):
            assert (thing.category, thing.ignore, thing.weight) == (known[number][0], False, 1.0)
            views = {
                t.view_index for t, _ in known_of(episode) if t.instance_id == number and t.modal.sum() > pixels / 999
            }
            assert {one.scene.view_index[v] for v in np.flatnonzero(thing.shown_by)} == views


@pytest.mark.slow
def test_a_run_told_to_stop_loses_no_batch_and_ends_like_one_that_was_not(recorded, tmp_path, monkeypatch):
    out, whole_run, losses = tmp_path / "run", tmp_path / "whole", BoxTask.losses

    def told(self, batch, step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return losses(self, batch, step)

    command = [str(recorded), "--val", str(recorded), *NEW]
    assert train3d.main([*command, "--out", str(whole_run)]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(BoxTask, "losses", told)
        assert train3d.main([*command, "--out", str(out)]) == 128 + signal.SIGTERM
    assert train3d.main([*command, "--out", str(out)]) == 0
    resumed, whole = (load_box_net(one / WEIGHTS_FILE).state_dict() for one in (out, whole_run))
    assert all(torch.equal(value, whole[name]) for name, value in resumed.items())
    histories = [json.loads((one / "history.json").read_text()) for one in (out, whole_run)]
    assert histories[0] == histories[1]


@pytest.mark.slow
def test_training_begins_with_a_memory_that_has_learnt(recorded, tmp_path, capsys):
    learnt = tmp_path / "memory"
    assert train_memory.main([str(recorded), "--out", str(learnt), *SIZE, "--planes", "8", "--width", "8", *(
        "--iterations", "2", "--validate-every", "2", "--inputs", "2", "--device", "cpu"
    )]) == 0  # fmt: skip
    memory, config = load_memory(learnt), json.loads((learnt / "train.json").read_text())
    scenes, _ = read_labelled_scenes([recorded], memory.spec)
    from labeling.memory.settings.box_settings import TrainBoxesConfig

    task = BoxTask(memory, scenes, [], TrainBoxesConfig())
    begun = task.network.memory.state_dict()
    assert all(torch.equal(value, begun[name]) for name, value in memory.state_dict().items())
    assert config["network"]["model"] == "grnn"
    out = tmp_path / "run"
    assert train3d.main([str(recorded), "--memory", str(learnt), "--out", str(out), *QUICK]) == 0
    assert load_box_net(out / WEIGHTS_FILE).spec.memory == memory.spec
    assert f"--channels is for a new memory; {learnt} has its own" in refused(
        capsys, train3d.main, recorded, "--memory", learnt, "--out", tmp_path / "other", *QUICK, "--channels", "8"
    )


@pytest.mark.slow
@pytest.mark.parametrize("around", ["fixated", "scene"])
def test_the_grid_stands_as_it_stood_when_the_memory_learnt(recorded, tmp_path, capsys, around):
    memory, out = tmp_path / MEMORY_FILE, tmp_path / "run"
    save_memory(memory, build_memory(TINY), {"around": around})
    command = [str(recorded), "--memory", str(memory), *QUICK, "--iterations", "1", "--validate-every", "1"]
    assert train3d.main([*command, "--out", str(out)]) == 0
    assert load_box_net(out / WEIGHTS_FILE).spec.around == around
    other = {"fixated": "scene", "scene": "fixated"}[around]
    capsys.readouterr()
    assert f"--around {other} contradicts {memory}, which has learnt with --around {around}" in refused(
        capsys, train3d.main, *command, "--around", other, "--out", tmp_path / "other"
    )
    assert train3d.main([*command, "--around", around, "--out", str(out)]) == 0


@pytest.mark.slow
def test_boxes_are_found_once_from_so_many_views(episodes, trained, capsys):
    assert detect3d.main([str(episodes), "--detector", str(trained)]) == 0
    file = read_json(episodes / "boxed_1" / "detections_3d.json")
    found = file.list_of("detections")
    assert found
    assert {one.text("category") for one in found} <= set(SIDES)
    assert all(np.all(read_valid_box_3d(one.get("box_3d")).extent_m > 0) for one in found)
    assert all(0 <= one.number("score") <= 1 for one in found)
    assert all(one.get("views").value == [0, 3] for one in found)
    capsys.readouterr()
    assert detect3d.main([str(episodes), "--detector", str(trained)]) == 0
    assert "0 boxes in 0 episodes; 2 were done already" in capsys.readouterr().out
    assert detect3d.main([str(episodes), "--detector", str(trained), "--views", "3"]) == 0
    found = read_json(episodes / "boxed_1" / "detections_3d.json").list_of("detections")
    assert all(one.get("views").value == [0, 2, 4] for one in found)


@pytest.mark.slow
def test_views_that_do_not_look_at_the_grid_are_refused_by_number(recorded, trained):
    detector, episode = load_memory_detector(trained, "cpu"), read_episode(recorded / "boxed_1")
    assert detector.find(episode, views=[4, 1])
    with pytest.raises(UsageError, match=r"boxed_1: none of views \[17\] looks"):
        detector.find(episode, views=[17])


@pytest.mark.slow
def test_wrong_combinations_are_refused_in_one_sentence(recorded, labels, trained, tmp_path, capsys):
    out = tmp_path / "out"
    for options, why in (
        (("--views", "4"), "--views is for --memory, which was not given"),
        (("--voxel-m", "0.3"), "--voxel-m is for --memory"),
        (("--memory", "cn3d", "--num-points", "64"), "--num-points is for frustum PointNets, not --memory"),
        (("--memory", "cn3d", "--flip", "0"), "--flip is for frustum PointNets"),
        (("--memory", "tower"), "there is no memory 'tower'; give grnn or cn3d, or the folder of a"),
        (("--memory", "cn3d", "--views", "0"), "--views must be above 0"),
        (("--memory", "cn3d", "--voxel-m", "-1"), "a grid has 4 to 512 voxels"),
        (("--memory", str(tmp_path)), "give the folder of a labeling.train_memory run"),
        (("--memory", str(trained)), "no such file; give the folder of a labeling.train_memory run"),
    ):
        assert why in refused(capsys, train3d.main, recorded, "--out", out, *options)
    assert "but 2 were given" in refused(
        capsys, train3d.main, labels, labels, "--dataset", recorded, "--out", out, *NEW
    )
    assert "holds a run with other data or settings" in refused(
        capsys, train3d.main, recorded, "--val", recorded, "--out", trained, *NEW, "--seed", "3"
    )
    assert "leave out --boxes" in refused(capsys, detect3d.main, recorded, "--detector", trained, "--boxes", "compact")
    assert "--views is for detectors with a memory" in refused(
        capsys, detect3d.main, recorded, "--detector", "ldls", "--views", "2"
    )
    assert "--views must be above 0" in refused(capsys, detect3d.main, recorded, "--detector", trained, "--views", "0")
    assert not out.exists()


@pytest.mark.slow
def test_a_memory_without_a_volume_is_refused(recorded, tmp_path, capsys):
    learnt = tmp_path / "tower"
    assert train_memory.main([str(recorded), "--model", "tower", "--out", str(learnt), *SIZE, *(
        "--iterations", "1", "--validate-every", "1", "--device", "cpu"
    )]) == 0  # fmt: skip
    assert "in the volume of a memory, which tower does not have; take grnn or cn3d" in refused(
        capsys, train3d.main, recorded, "--memory", learnt, "--out", tmp_path / "out", *QUICK
    )


@pytest.mark.slow
def test_episodes_without_boxes_are_refused(recorded, tmp_path, capsys):
    for seed in (1, 2):
        folder = Path(shutil.copytree(recorded / f"boxed_{seed}", tmp_path / "bare" / f"boxed_{seed}"))
        (folder / "ground_truth.json").unlink()
    assert "holds no object with a 3-D box" in refused(
        capsys, train3d.main, tmp_path / "bare", "--out", tmp_path / "run", *NEW
    )


def test_weights_are_read_as_they_were_written_and_malformed_ones_refused(tmp_path):
    torch.manual_seed(0)
    network, path = BoxNet(BoxSpec(("crate",), TINY)), tmp_path / WEIGHTS_FILE
    save_box_net(path, network, {"labels": "made up"})
    again = load_box_net(path)
    assert again.spec == network.spec
    assert all(torch.equal(value, network.state_dict()[name]) for name, value in again.state_dict().items())
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DetectorError, match="is damaged or no safetensors file"):
        load_box_net(path)
    for spec, why in (
        ("{", "the description of its network is damaged"),
        ('{"categories": []}', "must know at least one category"),
        ('{"categories": ["a"], "memory": {"model": "tower"}}', "which tower does not have"),
        ('{"categories": ["a", "b"]}', "its tensors are not those of a network that finds a, b in a memory"),
    ):
        save_weights(path, network, {SPEC_KEY: spec})
        with pytest.raises(DetectorError, match=why):
            load_box_net(path)
    save_weights(path, network, {"frustum_net": "{}"})
    with pytest.raises(DetectorError, match=r"does not say of which network; make it with labeling.train3d --memory"):
        load_box_net(path)
    with torch.no_grad():
        network.head.flat.weight[0] = torch.nan
    save_box_net(path, network, {})
    with pytest.raises(DetectorError, match="holds NaN or infinity"):
        load_box_net(path)
