import json
import os
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labeling import detect3d, train3d
from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import UsageError
from labeling.detectors3d.frustum_samples import read_frustum_samples
from labeling.formats.checked_json import read_json
from labeling.generate import main as generate
from labeling.io.coco import read_valid_box_3d
from labeling.io.episodes import write_episode
from labeling.training.config import WEIGHTS_FILE

from .boxed_rooms import SIDES, boxed_room

QUICK = (
    "--iterations", "4", "--batch-size", "4", "--num-points", "64", "--width", "0.1", "--validate-every", "2",
    "--device", "cpu",
)  # fmt: skip


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
    assert train3d.main([str(recorded), "--out", str(out), *QUICK]) == 0
    return out


@pytest.fixture
def episodes(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "episodes"))


@pytest.mark.slow
def test_training_on_labels_says_what_it_learnt_and_where_it_is(labels, recorded, tmp_path, capsys):
    out = tmp_path / "run"
    assert train3d.main([str(labels), "--out", str(out), "--val", str(recorded), *QUICK]) == 0
    said = capsys.readouterr().out
    assert "crate, locker" in said or "crate" in said
    assert f"detector: {out}" in said
    results = json.loads((out / "results.json").read_text())
    assert results["iterations"] == 4
    assert 0 <= results["validation"]["mean_iou"] <= 1
    assert train3d.main([str(labels), "--out", str(out), "--val", str(recorded), *QUICK]) == 0
    assert "going on from step 4" in capsys.readouterr().out


@pytest.mark.slow
def test_a_training_told_to_stop_loses_no_batch(labels, recorded, tmp_path, monkeypatch, capsys):
    from labeling.detectors3d.frustum_detector import load_network
    from labeling.detectors3d.frustum_training import FrustumTask

    command, losses = [str(labels), "--val", str(recorded), *QUICK], FrustumTask.losses

    def told_in_step_2(self, batch, step):
        if step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return losses(self, batch, step)

    assert train3d.main([*command, "--out", str(tmp_path / "whole")]) == 0
    with monkeypatch.context() as patch:
        patch.setattr(FrustumTask, "losses", told_in_step_2)
        assert train3d.main([*command, "--out", str(tmp_path / "told")]) == 128 + signal.SIGTERM
    assert "the same command goes on with what is missing" in capsys.readouterr().err
    assert train3d.main([*command, "--out", str(tmp_path / "told")]) == 0
    assert "going on from step 3" in capsys.readouterr().out
    resumed, whole = (load_network(tmp_path / name / WEIGHTS_FILE).state_dict() for name in ("told", "whole"))
    assert all(np.array_equal(value, whole[name]) for name, value in resumed.items())


@pytest.mark.slow
def test_several_sources_are_learnt_from_together(labels, recorded, tmp_path, capsys):
    out = tmp_path / "run"
    assert train3d.main([str(labels), str(recorded), "--out", str(out), "--val", str(recorded), *QUICK]) == 0
    both = len(read_frustum_samples(labels)) + len(read_frustum_samples(recorded))
    assert f"{both} objects in views to learn from" in capsys.readouterr().out
    assert json.loads((out / "results.json").read_text())["labels"] == f"{labels}, {recorded}"
    other = str(tmp_path / "other")
    assert "but 2 were given" in refused(
        capsys, train3d.main, str(labels), str(labels), "--dataset", str(recorded), "--out", other
    )
    assert "nothing to learn from was given" in refused(capsys, train3d.main, "--out", other)


def test_labels_teach_masks_and_boxes_that_fit_the_objects(labels, recorded):
    ours, truths = read_frustum_samples(labels), read_frustum_samples(recorded)
    assert len(ours) > 10
    for one in ours:
        best = max(box_iou_3d(one.box, true.box) for true in truths if true.category == one.category)
        assert best > 0.3
        assert 0 < one.weight <= 1


def test_objects_that_choose_are_not_learnt_from(recorded):
    kept, held = train3d.train_val_split_by_object(read_frustum_samples(recorded) * 3)
    assert held == [] or not {one.box.centre_m.tobytes() for one in kept} & {one.box.centre_m.tobytes() for one in held}
    assert len(kept) + len(held) == 3 * len(read_frustum_samples(recorded))


def test_every_tenth_object_is_held_out_but_no_category_as_a_whole(recorded):
    sample = read_frustum_samples(recorded)[0]

    def views_of(number, category):
        box = replace(sample.box, centre_m=np.array([number, 0.0, 0.0]))
        return [replace(sample, category=category, box=box) for _ in range(3)]

    def held_out(categories):
        objects = [one for number, name in enumerate(categories) for one in views_of(number, name)]
        kept, held = train3d.train_val_split_by_object(objects)
        assert len(kept) + len(held) == len(objects)
        return [int(one.box.centre_m[0]) for one in held]

    assert held_out(["chair"] * 25) == [9] * 3 + [19] * 3
    assert held_out([*["chair"] * 9, "bed", *["chair"] * 9, "chair"]) == [19] * 3
    assert held_out([*["chair"] * 9, "bed", "bed"]) == [9] * 3


@pytest.mark.parametrize("detector", ["ldls", "trained"])
def test_detecting_writes_boxes_once(episodes, trained, detector, capsys):
    name = str(trained) if detector == "trained" else detector
    assert detect3d.main([str(episodes), "--detector", name]) == 0
    found = read_json(episodes / "boxed_1" / "detections_3d.json").list_of("detections")
    assert len(found) > 5
    assert {one.text("category") for one in found} <= set(SIDES)
    assert all(np.all(read_valid_box_3d(one.get("box_3d")).extent_m > 0) for one in found)
    assert all(0 <= one.number("score") <= 1 and 0 <= one.integer("view") < 6 for one in found)
    capsys.readouterr()
    assert detect3d.main([str(episodes), "--detector", name]) == 0
    assert "0 boxes in 0 episodes; 2 were done already" in capsys.readouterr().out


def test_boxes_of_another_detector_replace_those_there(episodes, trained):
    path = episodes / "boxed_1" / "detections_3d.json"
    assert detect3d.main([str(episodes), "--detector", "ldls"]) == 0
    first = path.read_text()
    assert detect3d.main([str(episodes), "--detector", str(trained)]) == 0
    assert path.read_text() != first


def test_views_that_are_read_otherwise_are_looked_at_anew(episodes, capsys):
    episode = episodes / "boxed_1"
    assert detect3d.main([str(episode), "--detector", "ldls"]) == 0
    assert capsys.readouterr().out.endswith(f"{episode / 'detections_3d.json'}\n")
    before = read_json(episode / "detections_3d.json").list_of("detections")
    assert detect3d.main([str(episode), "--detector", "ldls", "--depth-unit-m", "0.002"]) == 0
    assert "were done already" not in capsys.readouterr().out
    after = read_json(episode / "detections_3d.json").list_of("detections")
    assert [one.get("box_3d").value for one in after] != [one.get("box_3d").value for one in before]


def test_a_recording_that_has_changed_is_looked_at_anew(episodes, capsys):
    command = [str(episodes), "--detector", "ldls"]
    assert detect3d.main(command) == 0
    depth = episodes / "boxed_1" / "depth" / "000.png"
    shutil.copyfile(depth.with_name("001.png"), depth)
    capsys.readouterr()
    assert detect3d.main(command) == 0
    assert "in 1 episodes; 1 were done already" in capsys.readouterr().out


def test_found_boxes_do_not_change_the_labels_of_an_episode(episodes, tmp_path, capsys):
    out = tmp_path / "labels"
    assert generate([str(episodes), "--out", str(out)]) == 0
    marks = [one["fingerprint"] for one in json.loads((out / "label_set.json").read_text())["episodes"]]
    assert detect3d.main([str(episodes), "--detector", "ldls"]) == 0
    assert generate([str(episodes), "--out", str(out)]) == 0
    assert [one["fingerprint"] for one in json.loads((out / "label_set.json").read_text())["episodes"]] == marks


def refused(capsys, main, *arguments: str) -> str:
    assert main(list(arguments)) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("error: ")
    assert "Traceback" not in error
    return error.splitlines()[-1]


def test_unknown_detectors_are_refused(episodes, capsys):
    assert "there is no 3-D detector" in refused(capsys, detect3d.main, str(episodes), "--detector", "nowhere")


def test_episodes_without_detections_need_a_2d_detector(episodes, capsys):
    (episodes / "boxed_1" / "detections.json").unlink()
    assert detect3d.main([str(episodes), "--detector", "ldls"]) == 2
    said = capsys.readouterr()
    assert "boxed_1: has no detections.json; give a 2-D detector with --boxes" in said.err
    assert (episodes / "boxed_2" / "detections_3d.json").is_file()
    assert not (episodes / "boxed_1" / "detections_3d.json").exists()


def test_no_boxes_nothing_to_learn(episodes, tmp_path, capsys):
    for folder in episodes.iterdir():
        path = folder / "ground_truth.json"
        content = json.loads(path.read_text())
        for one in content["annotations"]:
            del one["box_3d"]
        path.write_text(json.dumps(content))
    error = refused(capsys, train3d.main, str(episodes), "--out", str(tmp_path / "run"), *QUICK)
    assert "holds no object with a 3-D box" in error
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"segmentation": {"size": [1, 1], "counts": "1"}}, "size: must be"),
        ({"image_id": 99999}, "unknown image id 99999"),
        ({"view": 77}, "has no view 77"),
    ],
)
def test_labels_that_do_not_fit_their_recordings_are_refused(labels, recorded, tmp_path, capsys, change, why):
    copy = Path(shutil.copytree(labels, tmp_path / "labels"))
    for name in ("instances_modal.json", "instances_amodal.json"):
        content = json.loads((copy / name).read_text())
        changed = content["annotations"][0]
        if "view" in change:
            changed = next(one for one in content["images"] if one["id"] == changed["image_id"])
        changed |= change
        (copy / name).write_text(json.dumps(content))
    command = [str(copy), "--dataset", str(recorded), "--out", str(tmp_path / "run"), *QUICK]
    assert why in refused(capsys, train3d.main, *command)


def test_polygons_teach_boxes_like_masks(labels, recorded, tmp_path):
    copy = Path(shutil.copytree(labels, tmp_path / "labels"))
    content = json.loads((copy / "instances_modal.json").read_text())
    for one in content["annotations"]:
        left, top, width, height = one["bbox"]
        one["segmentation"] = [[left, top, left + width, top, left + width, top + height, left, top + height]]
    (copy / "instances_modal.json").write_text(json.dumps(content))
    assert read_frustum_samples(copy, dataset=recorded)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"extent": [1.0, 0.0, 1.0]}, "extent of a 3-D box must be above 0"),
        ({"extent": [1.0, 1.0]}, "extent"),
        ({"rotation": [[2.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, "must be a rotation"),
        ({"centre": ["a", 0, 0]}, "centre"),
    ],
)
def test_malformed_boxes_are_refused_by_name(labels, tmp_path, capsys, change, why):
    copy = tmp_path / "labels"
    shutil.copytree(labels, copy)
    about = json.loads((copy / "label_set.json").read_text())
    about["dataset"] = str((labels / about["dataset"]).resolve())
    (copy / "label_set.json").write_text(json.dumps(about))
    content = json.loads((copy / "boxes_3d.json").read_text())
    content["boxes"][0] |= change
    (copy / "boxes_3d.json").write_text(json.dumps(content))
    error = refused(capsys, train3d.main, str(copy), "--out", str(tmp_path / "run"), *QUICK)
    assert "boxes_3d.json" in error
    assert why in error


@pytest.mark.parametrize(
    ("flags", "why"),
    [
        (("--iterations", "0"), "--iterations must be above 0"),
        (("--batch-size", "1"), "--batch-size must be 2 or more"),
        (("--flip", "2"), "--flip must lie in [0, 1]"),
        (("--noise-m", "-1"), "--noise-m must be 0 or more"),
    ],
)
def test_settings_that_make_no_sense_are_refused(recorded, tmp_path, capsys, flags, why):
    arguments = [str(recorded), "--out", str(tmp_path / "run"), *flags]
    assert why in refused(capsys, train3d.main, *arguments)


def test_a_label_set_without_its_recordings_is_refused(labels, recorded, tmp_path):
    (tmp_path / "other").mkdir()
    shutil.copytree(recorded / "boxed_1", tmp_path / "other" / "boxed_1")
    with pytest.raises(UsageError, match="lacks episode 'boxed_2'"):
        read_frustum_samples(labels, dataset=tmp_path / "other")
