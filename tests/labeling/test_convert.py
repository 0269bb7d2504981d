"""Any recording becomes an episode; a label set made from a thinned-out recording still evaluates on its views."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labeling.convert import main
from labeling.evaluate import main as evaluate
from labeling.generate import main as generate
from labeling.io.episodes import read_episode, write_episode

from .generator.test_sources import shared_file
from .io.recordings.recording_writers import WRITERS
from .synthetic_room import make_episode, pick


@pytest.fixture(scope="module")
def room():
    return make_episode(4, num_views=5, size=(36, 48), num_objects=3)


@pytest.mark.parametrize("layout", WRITERS)
def test_a_converted_recording_is_the_same_episode(tmp_path, room, layout, capsys):
    (tmp_path / "in").mkdir()
    WRITERS[layout](tmp_path / "in", room)
    flags = ["--up", "y"] if layout == "record3d" else []
    assert main([str(tmp_path / "in"), "--out", str(tmp_path / "out"), *flags]) == 0
    assert "5 views of 48x36 pixels" in capsys.readouterr().out
    found = read_episode(tmp_path / "out")
    np.testing.assert_array_equal(found.rgb, room.rgb)
    np.testing.assert_allclose(found.depth_m, room.depth_m, atol=0.0006)
    np.testing.assert_allclose(found.camera_to_world, room.camera_to_world, atol=1e-7)


@pytest.mark.parametrize("detected", [True, False])
def test_what_comes_next_depends_on_whether_there_are_detections(tmp_path, room, capsys, detected):
    write_episode(tmp_path / "in", room if detected else replace(room, detections=None))
    assert main([str(tmp_path / "in"), "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert ("labeling.generate" in said, "labeling.detect" in said) == (detected, not detected)


def test_detections_that_undistortion_moves_out_of_the_picture_are_left_out(tmp_path, room):
    write_episode(tmp_path / "in", room)
    path = tmp_path / "in" / "transforms.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "k1": -0.5}))
    boxes = [[0, 0, 2, 2], [10, 10, 20, 15]]
    records = [{"image_id": 0, "category_id": 1, "bbox": box, "score": 0.5} for box in boxes]
    (tmp_path / "in" / "detections.json").write_text(json.dumps(records))
    assert main([str(tmp_path / "in"), "--undistort", "--out", str(tmp_path / "out")]) == 0
    found = read_episode(tmp_path / "out").detections
    assert found is not None
    assert [one.mask.any() for one in found] == [True]


@pytest.mark.parametrize("layout", WRITERS)
def test_nothing_is_written_into_a_recording(tmp_path, room, layout, capsys):
    (tmp_path / "in").mkdir()
    WRITERS[layout](tmp_path / "in", room)
    assert main([str(tmp_path / "in"), "--out", str(tmp_path / "in" / "below" / "out")]) == 2
    assert "lies inside the recording" in capsys.readouterr().err
    assert not (tmp_path / "in" / "below").exists()


def test_an_episode_may_be_named_for_a_time_of_day(tmp_path, room):
    episode = tmp_path / "2024-05-01T12:30:00"
    write_episode(episode, room)
    assert generate([str(episode), "--out", str(tmp_path / "labels")]) == 0
    assert main([str(tmp_path / "labels"), "--to", "masks", "--out", str(tmp_path / "out")]) == 0
    assert main([str(tmp_path / "labels"), "--to", "gltf", "--out", str(tmp_path / "clouds")]) == 0


def test_an_existing_folder_is_left_alone(tmp_path, room, capsys):
    (tmp_path / "in").mkdir()
    WRITERS["tum"](tmp_path / "in", room)
    (tmp_path / "out").mkdir()
    assert main([str(tmp_path / "in"), "--out", str(tmp_path / "out")]) == 2
    assert "exists already" in capsys.readouterr().err
    assert list((tmp_path / "out").iterdir()) == []


def test_a_malformed_recording_writes_nothing(tmp_path, room, capsys):
    (tmp_path / "in").mkdir()
    WRITERS["scannet"](tmp_path / "in", room)
    (tmp_path / "in" / "pose" / "0.txt").write_text("1")
    assert main([str(tmp_path / "in"), "--out", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["tum", "scannet"])
def test_a_thinned_recording_is_labelled_and_evaluated_on_the_views_taken(tmp_path, layout):
    room = make_episode(5, num_views=6, size=(48, 64), num_objects=3, confident_share=2.0)
    folder = tmp_path / "room_5"
    folder.mkdir()
    WRITERS[layout](folder, room)
    names = read_episode(folder).file_names
    content = shared_file([room])
    for image, name in zip(content["images"], names, strict=True):
        image["file_name"] = name
    (folder / "detections.json").write_text("[]")
    (tmp_path / "all.json").write_text(json.dumps(content))
    write_episode(tmp_path / "truth", room)
    truth = json.loads((tmp_path / "truth" / "ground_truth.json").read_text())
    for image, name in zip(truth["images"], names, strict=True):
        image["file_name"] = name
    (folder / "ground_truth.json").write_text(json.dumps(truth))
    out, every = tmp_path / "labels", ["--every", "2"]
    assert generate([str(folder), "--out", str(out), *every, "--detections", str(tmp_path / "all.json")]) == 0
    coco = json.loads((out / "instances_modal.json").read_text())
    assert [image["file_name"] for image in coco["images"]] == list(names[::2])
    assert evaluate([str(out)]) == 0
    found = json.loads((out / "metrics.json").read_text())
    # The same views as an episode of their own, which needs no options.
    thin = pick(room, [0, 2, 4])
    write_episode(tmp_path / "thin" / "room_5", thin)
    assert generate([str(tmp_path / "thin" / "room_5"), "--out", str(tmp_path / "again")]) == 0
    assert evaluate([str(tmp_path / "again")]) == 0
    expected = json.loads((tmp_path / "again" / "metrics.json").read_text())
    assert found["counts"] == expected["counts"]
    assert found["detector"] == expected["detector"]
    assert found["pseudo_labels"]["mean_iou"] == pytest.approx(expected["pseudo_labels"]["mean_iou"], abs=0.02)
    assert found["pseudo_labels"]["mean_iou"] > 0.4


@pytest.mark.parametrize("command", ["labeling.convert", "labeling.inspect"])
def test_help_imports_nothing_heavy(command):
    code = (
        f"import sys, {command} as c\n"
        "try: c.main(['--help'])\n"
        "except SystemExit: pass\n"
        "print('HEAVY', sorted({'numba', 'sklearn', 'scipy', 'cv2', 'open3d', 'torch', 'viser'} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    assert "HEAVY []" in result.stdout
