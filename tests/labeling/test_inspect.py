"""Inspection finds every kind of planted fault, and nothing in a sound label set."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import LabelFormatError
from labeling.core.rle import encode_mask
from labeling.core.types import Box3d
from labeling.evaluate import main as evaluate
from labeling.formats.ply import read_ply
from labeling.generate import main as generate
from labeling.inspect import main
from labeling.inspection.checks import inspect_label_set
from labeling.inspection.pictures import SIZE
from labeling.inspection.scene import read_scenes
from labeling.io.episodes import find_episodes, write_episode

from .synthetic_room import make_episode


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("sound")
    for seed in (1, 2):
        room = make_episode(seed, num_views=4, size=(48, 64), num_objects=3, confident_share=2.0)
        write_episode(root / "data" / room.name, room)
    assert generate([str(root / "data"), "--out", str(root / "labels")]) == 0
    return root


@pytest.fixture
def labels(sound, tmp_path) -> Path:
    shutil.copytree(sound, tmp_path / "set")
    return tmp_path / "set" / "labels"


def edit(file: Path, change) -> None:
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def test_a_sound_label_set_has_no_problem(labels, capsys):
    assert inspect_label_set(labels) == []
    assert main([str(labels)]) == 0
    assert "no problem found" in capsys.readouterr().out


@pytest.mark.slow
def test_poses_that_do_not_fit_depth_are_a_problem_and_mended_ones_a_note(tmp_path, capsys):
    room = make_episode(1, num_views=6, size=(48, 64), num_objects=3, confident_share=2.0)
    poses = room.camera_to_world.copy()
    poses[2, :3, 3] += [0.15, -0.15, 0.1]
    write_episode(tmp_path / "data" / room.name, replace(room, camera_to_world=poses))
    for mode, code, line in (("off", 1, "--refine-poses auto would mend them"), ("auto", 0, "with refined poses")):
        labels = tmp_path / mode
        assert generate([str(tmp_path / "data"), "--out", str(labels), "--refine-poses", mode]) == 0
        assert line in capsys.readouterr().err
        assert main([str(labels)]) == code
        said = capsys.readouterr().out
        assert line in said
        assert "in view 2 by" in said
        about = json.loads((labels / "label_set.json").read_text())["episodes"][0]["poses"]
        assert about["refined"] == (mode == "auto")
        assert about["refined_residual_m"] < about["residual_m"]
    assert evaluate([str(tmp_path / "auto")]) == 0
    assert "note: room_1: poses do not fit depth" in capsys.readouterr().out


def test_the_set_may_be_looked_at_without_its_dataset(labels):
    shutil.rmtree(labels.parent / "data")
    assert inspect_label_set(labels) == []
    assert all(scene.cameras == () for scene in read_scenes(labels))


@pytest.mark.slow
def test_depth_that_lies_beside_colour_is_a_problem(tmp_path):
    room = make_episode(3, num_views=6, size=(120, 160), num_objects=5, confident_share=2.0)
    write_episode(tmp_path / "data" / "room", replace(room, depth_m=np.roll(room.depth_m, 10, axis=2)))
    assert generate([str(tmp_path / "data"), "--out", str(tmp_path / "labels")]) == 0
    problems = [one for one in inspect_label_set(tmp_path / "labels") if "registered" in one]
    assert len(problems) == 1
    assert "room: edges of depth lie 10 pixels to the right" in problems[0]


def first(name: str, value: Any):
    return lambda content: content["annotations"][0].update({name: value})


def empty(content):
    size = content["annotations"][0]["segmentation"]["size"]
    content["annotations"][0]["segmentation"] = encode_mask(np.zeros(size, bool))


def twin(content):
    content["boxes"].append({**content["boxes"][0], "instance_id": 99})


def far(content):
    content["boxes"][0]["extent"] = [1.0, 0.0, 1.0]


MODAL, AMODAL, BOXES = "instances_modal.json", "instances_amodal.json", "boxes_3d.json"
FAULTS = [
    (MODAL, first("image_id", 999), r"annotations\[0\].image_id: there is no image 999"),
    (MODAL, first("source_image_id", 999), r"annotations\[0\].source_image_id: there is no image 999"),
    (MODAL, first("category_id", 999), r"annotations\[0\].category_id: there is no category 999"),
    (MODAL, first("instance_id", 999), r"annotations\[0\].instance_id: there is no object 999"),
    (MODAL, first("score", 1.5), r"annotations\[0\].score: a score lies in \[0, 1\], not 1.5"),
    (MODAL, first("score", float("nan")), r"annotations\[0\].score: a score lies"),
    (MODAL, first("score", None), r"annotations\[0\].score: a score lies"),
    (MODAL, first("source_score", -1), r"annotations\[0\].source_score: a score lies"),
    (MODAL, first("bbox", [0, 0, 65, 4]), r"annotations\[0\].bbox: .* leaves the picture of 64x48"),
    (MODAL, first("bbox", [0, 0, 1, 1]), r"annotations\[0\].bbox: is .*, but the mask fills"),
    (MODAL, first("area", 1), r"annotations\[0\].area: is 1, but the mask has"),
    (MODAL, first("segmentation", {"size": [48, 64], "counts": "zz"}), r"annotations\[0\].segmentation: RLE"),
    (MODAL, first("segmentation", {"size": [8, 8], "counts": [64]}), r"annotations\[0\].segmentation.size: must be"),
    (MODAL, empty, r"annotations\[0\].segmentation: the mask is empty"),
    (MODAL, lambda c: c["annotations"].append(dict(c["annotations"][0])), r"\.id: \d+ is given twice"),
    (MODAL, lambda c: c["annotations"].append({**c["annotations"][0], "id": 9999}), r"has a second label in image"),
    (MODAL, lambda c: c["images"].append(dict(c["images"][0])), r"images\[8\].id: 1 is given twice"),
    (MODAL, lambda c: c["categories"].append(dict(c["categories"][0])), r"categories\[\d\].id: 1 is given twice"),
    (MODAL, lambda c: c["images"][0].update(file_name="gone.png"), r"images\[0\].file_name: 'gone.png' is not in"),
    (AMODAL, lambda c: [a.update(segmentation=encode_mask(np.eye(48, 64) > 0)) for a in c["annotations"]], "lacks pix"),
    (BOXES, twin, r"boxes\[\d\]: object 99 \(\w+\) and object \d+ \(\w+\) of room_1 share 100% of their space"),
    (BOXES, far, r"boxes\[0\].extent: the extent of a 3-D box must be above 0"),
    (
        BOXES,
        lambda c: c["boxes"][0].update(rotation=[[2, 0, 0], [0, 1, 0], [0, 0, 1]]),
        r"boxes\[0\].rotation: must be",
    ),
    (BOXES, lambda c: c["boxes"][0].update(score=-0.1), r"boxes\[0\].score: a score lies"),
    (BOXES, lambda c: c["boxes"][0].update(category_id=77), r"boxes\[0\].category_id: there is no category 77"),
    (BOXES, lambda c: c["boxes"][0].update(episode="room_2"), r"instance_id: object 1 belongs to episode room_2"),
    (
        "label_set.json",
        lambda c: c["episodes"][0].update(status="failed", error="why"),
        r"room_1 was not labelled \(why",
    ),
    ("label_set.json", lambda c: c["episodes"].pop(), r"episodes: does not tell of episode room_2"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("file", "change", "message"), FAULTS, ids=[message[:48] for _, _, message in FAULTS])
def test_planted_faults_are_found(labels, capsys, file, change, message):
    import re

    edit(labels / file, change)
    problems = inspect_label_set(labels)
    assert any(re.search(message, problem) for problem in problems), problems
    assert main([str(labels)]) == 1
    printed = capsys.readouterr().out.splitlines()
    assert printed[: len(problems)] == problems


def test_points_without_a_place_are_told_and_not_drawn(labels, tmp_path):
    cloud = labels / "clouds" / "room_1.ply"
    content = read_ply(cloud).copy()
    content["x"][:2] = np.nan
    cloud.write_bytes(cloud.read_bytes()[: -content.nbytes] + content.tobytes())
    assert any("room_1.ply: 2 points have no finite place" in problem for problem in inspect_label_set(labels))
    scene, _ = read_scenes(labels)
    assert np.isfinite(scene.points).all()
    assert len(scene.points) == len(scene.labels) == len(content["x"]) - 2


def test_recordings_are_looked_for_once_not_for_every_episode(labels, monkeypatch):
    asked = []

    def found(*arguments):
        asked.append(arguments)
        return find_episodes(*arguments)

    monkeypatch.setattr("labeling.inspection.scene.find_episodes", found)
    assert all(scene.cameras for scene in read_scenes(labels))
    assert len(asked) == 1


def test_missing_and_broken_clouds_are_found(labels):
    (labels / "clouds" / "room_1.ply").unlink()
    cloud = labels / "clouds" / "room_2.ply"
    cloud.write_bytes(cloud.read_bytes()[:-1])
    problems = inspect_label_set(labels)
    assert [("room_1.ply: the segmented cloud is missing" in p, "truncated" in p) for p in problems] == [
        (True, False),
        (False, True),
    ]


def test_categories_without_labels_are_noted_but_no_fault(labels, capsys):
    edit(labels / MODAL, lambda content: content["categories"].append({"id": 50, "name": "submarine"}))
    assert main([str(labels)]) == 0
    assert "note: no label has the categories" in (printed := capsys.readouterr().out)
    assert "submarine" in printed


@pytest.mark.parametrize("file", [MODAL, BOXES, "label_set.json"])
@pytest.mark.parametrize("spoil", ["missing", "text", "list"])
def test_what_cannot_be_read_is_one_line_and_exit_code_2(labels, capsys, file, spoil):
    if spoil == "missing":
        (labels / file).unlink()
    else:
        (labels / file).write_text("hello" if spoil == "text" else "[]")
    assert main([str(labels)]) == 2
    captured = capsys.readouterr()
    assert len(captured.err.strip().splitlines()) == 1
    assert file in captured.err
    assert captured.out == ""


def test_a_folder_that_is_not_there_is_told(tmp_path, capsys):
    assert main([str(tmp_path / "nothing")]) == 2
    assert "no such folder" in capsys.readouterr().err


json_values = st.sampled_from([None, True, 0, -1, 10**30, 0.5, "", "x", [], {}, [1], {"a": 1}])


@pytest.fixture(scope="module")
def fuzzed(sound, tmp_path_factory) -> tuple[Path, dict[str, str]]:
    folder = tmp_path_factory.mktemp("fuzz") / "labels"
    shutil.copytree(sound / "labels", folder)
    return folder, {file: (folder / file).read_text() for file in (MODAL, AMODAL, BOXES, "label_set.json")}


@pytest.mark.slow
@settings(max_examples=150)
@given(data=st.data())
def test_whatever_a_label_set_holds_inspection_finds_words_for_it(fuzzed, data):
    folder, texts = fuzzed
    for file, text in texts.items():
        (folder / file).write_text(text)
    name = data.draw(st.sampled_from(sorted(texts)))
    content = {"root": json.loads(texts[name])}
    parent: Any = content
    key: Any = "root"
    while isinstance(parent[key], dict | list) and parent[key] and data.draw(st.integers(0, 4)):
        parent = parent[key]
        key = data.draw(st.sampled_from(sorted(parent) if isinstance(parent, dict) else range(len(parent))))
    parent[key] = data.draw(json_values)
    (folder / name).write_text(json.dumps(content["root"]))
    try:
        lines = inspect_label_set(folder)
    except LabelFormatError as error:
        lines = [str(error)]
    assert all("\n" not in line for line in lines)


# Boxes ---------------------------------------------------------------------------------------------------------------


def upright(x: float, y: float, sides: tuple[float, float, float], yaw: float = 0.0) -> Box3d:
    c, s = np.cos(yaw), np.sin(yaw)
    return Box3d(np.array([x, y, 0.0]), np.array(sides), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))


def shared_area(one: Box3d, other: Box3d) -> float:
    """Of two footprints: Qhull intersects the half-planes of their sides."""
    rows = []
    for box in (one, other):
        for axis in range(2):
            for sign in (1.0, -1.0):
                normal = sign * box.rotation[:2, axis]
                rows.append([*normal, -normal @ box.centre_m[:2] - 0.5 * box.extent_m[axis]])
    sides = np.array(rows)
    # The middle of the largest circle inside: normals have length 1.
    found = linprog([0, 0, -1], np.c_[sides[:, :2], np.ones(8)], -sides[:, 2], bounds=[(None, None)] * 3)
    if found.x[2] < 1e-9:
        return 0.0
    return ConvexHull(HalfspaceIntersection(sides, found.x[:2]).intersections).volume


@settings(max_examples=60)
@given(st.floats(-1.2, 1.2), st.floats(-1.2, 1.2), st.floats(0.3, 1.5), st.floats(0.3, 1.5), st.floats(0, 3.14))
@example(0.0, 0.166015625, 0.634765625, 0.3125, 1.961750912701552)  # OpenCV's intersection is off by .0001 here
def test_overlap_of_boxes_is_that_of_their_footprints(x, y, a, b, yaw):
    """Upright boxes of one height have the IoU of their footprints."""
    one, other = upright(0, 0, (1.0, 0.8, 1.0)), upright(x, y, (a, b, 1.0), yaw)
    shared = shared_area(one, other)
    assert box_iou_3d(one, other) == pytest.approx(shared / (0.8 + a * b - shared), abs=1e-6)


def test_a_box_overlaps_itself_wholly_and_a_far_one_not_at_all():
    box = upright(0, 0, (1.0, 2.0, 3.0), 0.3)
    assert box_iou_3d(box, box) == pytest.approx(1.0)
    assert box_iou_3d(box, upright(10, 0, (1.0, 2.0, 3.0))) == 0.0


# Pictures and viewer -------------------------------------------------------------------------------------------------


def test_pictures_show_every_object_in_its_colour(labels, tmp_path, capsys):
    assert main([str(labels), "--pictures", str(tmp_path / "pictures"), "--viewpoints", "2"]) == 0
    files = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert files == [f"room_{room}_{name}.png" for room in (1, 2) for name in ("1", "2", "top")]
    for scene in read_scenes(labels):
        picture = cv2.imread(str(tmp_path / "pictures" / f"{scene.name}_top.png"))
        assert picture is not None
        assert picture.shape == (*SIZE, 3)
        assert len(scene.objects) > 0
        for one in scene.objects:
            edge = np.array([int(255 * value * 0.75) for value in one.colour])[::-1]
            assert (np.abs(picture.astype(int) - edge).max(axis=2) <= 2).sum() > 20
        assert (picture == 250).all(axis=2).mean() < 0.9


def test_scenes_know_the_cameras_of_their_recording(labels, sound):
    from labeling.io.episodes import read_episode

    for scene in read_scenes(labels):
        episode = read_episode(sound / "data" / scene.name)
        np.testing.assert_allclose([camera.camera_to_world for camera in scene.cameras], episode.camera_to_world)
        np.testing.assert_allclose([camera.intrinsics for camera in scene.cameras], episode.intrinsics)
        assert {camera.size for camera in scene.cameras} == {(48, 64)}


def test_the_viewer_says_what_it_needs(labels, capsys, monkeypatch):
    import builtins

    original = builtins.__import__

    def without_viser(name, *arguments, **keywords):
        if name == "viser":
            raise ImportError(name)
        return original(name, *arguments, **keywords)

    monkeypatch.setattr(builtins, "__import__", without_viser)
    assert main([str(labels), "--view"]) == 2
    assert "pip install './CLONE[viewer]'" in capsys.readouterr().err
