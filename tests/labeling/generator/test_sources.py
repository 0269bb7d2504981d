"""Detections from one file for all, from a Python callable, and COCO polygons."""

import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.detector import DetectorError, run_detector
from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.masks import fill_polygons
from labeling.detectors.adapters.function import load_function
from labeling.detectors.registry import load_detector
from labeling.generate import main
from labeling.generator.detection_pooling import pool_detections
from labeling.generator.sources import detections_record, with_source_detections
from labeling.io.episodes import read_episode, write_episode

from ..synthetic_room import make_episode


@pytest.fixture(scope="module")
def rooms() -> list[Episode]:
    return [make_episode(seed, num_views=4, size=(48, 64), num_objects=3, confident_share=2.0) for seed in (1, 2)]


@pytest.fixture
def dataset(rooms, tmp_path) -> Path:
    for room in rooms:
        write_episode(tmp_path / "data" / room.name, room)
    return tmp_path / "data"


def shared_file(rooms: list[Episode]) -> dict:
    """One COCO file of all episodes, with file names relative to the dataset."""
    content: dict = {"images": [], "categories": [], "annotations": []}
    for number, room in enumerate(rooms):
        one = detections_record(room, room.detections or (), {})
        content["categories"] = one["categories"]
        content["images"] += [
            {**image, "id": 100 * number + image["id"], "file_name": f"{room.name}/{image['file_name']}"}
            for image in one["images"]
        ]
        content["annotations"] += [
            {**record, "image_id": 100 * number + record["image_id"]} for record in one["annotations"]
        ]
    return content


def labels_of(out: Path) -> bytes:
    return (out / "instances_modal.json").read_bytes() + (out / "boxes_3d.json").read_bytes()


# One file ------------------------------------------------------------------------------------------------------------


def test_one_file_for_all_episodes_labels_as_their_own_files_do(dataset, rooms, tmp_path):
    assert main([str(dataset), "--out", str(tmp_path / "own")]) == 0
    file = tmp_path / "all.json"
    file.write_text(json.dumps(shared_file(rooms)))
    for room in rooms:
        (dataset / room.name / "detections.json").unlink()
    assert main([str(dataset), "--out", str(tmp_path / "shared"), "--detections", str(file)]) == 0
    assert labels_of(tmp_path / "shared") == labels_of(tmp_path / "own")


def test_a_bare_list_of_results_is_for_one_episode(dataset, rooms, tmp_path, capsys):
    assert main([str(dataset / rooms[0].name), "--out", str(tmp_path / "own")]) == 0
    file = Path(shutil.move(dataset / rooms[0].name / "detections.json", tmp_path / "results.json"))
    assert main([str(dataset / rooms[0].name), "--out", str(tmp_path / "list"), "--detections", str(file)]) == 0
    assert labels_of(tmp_path / "list") == labels_of(tmp_path / "own")
    assert main([str(dataset), "--out", str(tmp_path / "both"), "--detections", str(file)]) == 2
    assert "does not tell which episode" in capsys.readouterr().err


def test_evaluation_scores_the_detections_that_were_used(dataset, rooms, tmp_path, capsys):
    from labeling.evaluate import main as evaluate

    content = shared_file(rooms)
    content["annotations"] = content["annotations"][:1]
    (tmp_path / "few.json").write_text(json.dumps(content))
    assert main([str(dataset), "--out", str(tmp_path / "out"), "--detections", str(tmp_path / "few.json")]) == 0
    assert evaluate([str(tmp_path / "out")]) == 0
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["counts"]["detections"] == 1


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--detections", "nowhere.json"), "--detections nowhere.json: no such file"),
        (("--annotations", "nowhere.json"), "--annotations nowhere.json: no such file"),
        (("--detector", "module"), "unknown detector 'module'; known: compact, "),
        (("--detector", "no_such_module_here:f"), "cannot be imported (ModuleNotFoundError"),
        (("--with-recorded",), "give one with --detector"),
        (("--detector", "json:dumps", "--weak", "one-view"), "--detector and --weak one-view contradict"),
    ],
)
def test_sources_that_make_no_sense_are_refused_before_anything_is_written(dataset, tmp_path, capsys, flags, message):
    assert main([str(dataset), "--out", str(tmp_path / "out"), *flags]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# A callable ----------------------------------------------------------------------------------------------------------

DETECTOR = '''
import numpy as np

CALLS = []

def find(rgb):
    """Everything in the middle of the picture is a chair."""
    CALLS.append(rgb.shape)
    assert rgb.dtype == np.uint8 and rgb.flags.writeable
    mask = np.zeros(rgb.shape[:2], bool)
    mask[10:30, 20:40] = True
    rgb[:] = 0
    return [("chair", np.float32(0.95), mask), ("plant", 0.2, mask.astype(np.uint8))]

def raising(rgb):
    raise RuntimeError("out of film\\nsecond line")

def returning_none(rgb):
    return None

def returning_text(rgb):
    return ["chair"]

def scoring_high(rgb):
    return [("chair", 1.5, np.ones(rgb.shape[:2], bool))]

def small_masks(rgb):
    return [("chair", 0.5, np.ones((3, 3), bool))]

def nameless(rgb):
    return [(7, 0.5, np.ones(rgb.shape[:2], bool))]

def blurred(rgb):
    return [("chair", 0.5, np.ones(rgb.shape[:2], float))]

number = 3
'''


@pytest.fixture
def detector(tmp_path, monkeypatch) -> Iterator[str]:
    name = f"detector_{tmp_path.name.replace('-', '_')}"
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / f"{name}.py").write_text(DETECTOR)
    monkeypatch.syspath_prepend(str(tmp_path / "code"))
    yield name
    sys.modules.pop(name, None)


def test_a_callable_sees_every_picture_once_and_leaves_it_alone(detector, rooms):
    before = rooms[0].rgb.copy()
    found = run_detector(load_detector(f"{detector}:find"), rooms[0])
    assert np.array_equal(rooms[0].rgb, before)
    assert len(sys.modules[detector].CALLS) == rooms[0].num_views
    assert [(one.view_index, one.category) for one in found] == [
        (view, name) for view in range(4) for name in ("chair", "plant")
    ]
    assert all(one.mask.dtype == bool and one.mask.sum() == 400 for one in found)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        ("raising", r"on rgb/000\.png of room_1: RuntimeError: out of film$"),
        ("returning_none", "must return a list of .* not NoneType"),
        ("returning_text", "each detection is .* not str"),
        ("scoring_high", "the confidence of 'chair' is 1.5"),
        ("small_masks", r"the mask of 'chair' is bool \(3, 3\); expected bool \(48, 64\)"),
        ("nameless", "a category is a name, not 7"),
        ("blurred", "the mask of 'chair' is float64"),
    ],
)
def test_whatever_a_callable_does_wrong_is_one_clear_sentence(detector, rooms, function, message):
    with pytest.raises(DetectorError, match=message):
        run_detector(load_detector(f"{detector}:{function}"), rooms[0])


@pytest.mark.parametrize("name", ["nothing", ":f", "m:", "json:nothing_there"])
def test_names_that_lead_nowhere_are_refused(name):
    with pytest.raises(UsageError, match="--detector"):
        load_function(name)


def test_what_is_no_function_is_refused(detector):
    with pytest.raises(UsageError, match="is a int, which cannot be called"):
        load_function(f"{detector}:number")


@pytest.mark.slow
def test_a_detector_runs_once_and_its_findings_are_a_detections_file(detector, dataset, rooms, tmp_path):
    out, name = tmp_path / "out", f"{detector}:find"
    for room in rooms:
        (dataset / room.name / "detections.json").unlink()
    assert main([str(dataset), "--out", str(out), "--detector", name]) == 0
    calls = sys.modules[detector].CALLS
    assert len(calls) == 8
    first = labels_of(out)
    assert main([str(dataset), "--out", str(out), "--detector", name, "--confident", "0.94"]) == 0
    assert len(calls) == 8
    kept = out / "detections" / f"{rooms[0].name}.json"
    kept.write_text("{")
    assert main([str(dataset), "--out", str(out), "--detector", name]) == 0
    assert len(calls) == 12
    assert labels_of(out) == first
    single = dataset / rooms[0].name
    assert main([str(single), "--out", str(tmp_path / "again"), "--detections", str(kept)]) == 0
    episode = json.loads((tmp_path / "again" / "label_set.json").read_text())["episodes"][0]
    assert episode["sources"] == str(kept)
    assert episode["objects"] > 0


def test_recorded_detections_speak_beside_those_of_a_detector(detector, dataset, rooms, tmp_path):
    out, name = tmp_path / "out", f"{detector}:find"
    assert main([str(dataset), "--out", str(out), "--detector", name, "--with-recorded"]) == 0
    about = json.loads((out / "label_set.json").read_text())
    assert about["episodes"][0]["sources"] == f"detector {name} and detections.json"
    found = run_detector(load_detector(name), rooms[0])
    folder = dataset / rooms[0].name
    used = with_source_detections(read_episode(folder), out, about).detections
    assert used is not None
    assert len(used) == len(pool_detections(found, read_episode(folder).detections or ()))
    assert len(used) > max(len(found), len(rooms[0].detections or ()))
    (folder / "detections.json").unlink()
    assert main([str(folder), "--out", str(tmp_path / "one"), "--detector", name, "--with-recorded"]) == 2


def test_a_failing_detector_is_one_line_and_leaves_no_labels(detector, dataset, tmp_path, capsys):
    assert main([str(dataset), "--out", str(tmp_path / "out"), "--detector", f"{detector}:raising"]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "error:" in line]
    assert len(lines) == 3
    assert "out of film" in lines[0]
    assert not (tmp_path / "out" / "detections").exists()


# Polygons ------------------------------------------------------------------------------------------------------------


@settings(max_examples=150)
@given(
    st.lists(
        st.lists(st.floats(-5, 45, allow_nan=False, width=32), min_size=6, max_size=14).map(
            lambda p: p[: len(p) // 2 * 2]
        ),
        min_size=1,
        max_size=3,
    )
)
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_polygons_are_filled_as_pycocotools_fills_them(polygons):
    from pycocotools import mask as pycoco_mask

    runs = pycoco_mask.merge(pycoco_mask.frPyObjects(polygons, 30, 40))
    np.testing.assert_array_equal(fill_polygons(polygons, (30, 40)), pycoco_mask.decode(runs).astype(bool))


def test_a_rectangle_covers_the_pixels_inside_it():
    mask = fill_polygons([[2, 3, 7, 3, 7, 9, 2, 9]], (12, 10))
    expected = np.zeros((12, 10), bool)
    expected[3:9, 2:7] = True
    np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize(
    "polygons", [[], [[]], "x", [[1, 2, 3, 4]], [[1, 2, 3, 4, 5]], [[1, 2, 3, 4, 5, None]], [[0] * 5 + [1e6]]]
)
def test_what_is_no_polygon_is_refused(polygons):
    with pytest.raises(ValueError, match="polygon"):
        fill_polygons(polygons, (10, 10))


def test_polygons_are_read_in_ground_truth_and_detections(dataset, rooms):
    folder = dataset / rooms[0].name
    for name, pick in (("ground_truth.json", lambda c: c["annotations"][0]), ("detections.json", lambda c: c[0])):
        content = json.loads((folder / name).read_text())
        pick(content)["segmentation"] = [[2, 3, 7, 3, 7, 9, 2, 9]]
        (folder / name).write_text(json.dumps(content))
    episode = read_episode(folder)
    assert episode.ground_truth is not None
    assert episode.detections is not None
    for mask in (episode.ground_truth[0].modal, episode.detections[0].mask):
        assert mask.sum() == 30
        assert mask[3:9, 2:7].all()


def test_an_episode_without_any_masks_is_told_all_ways_to_give_them(dataset, rooms, tmp_path, capsys):
    for room in rooms:
        (dataset / room.name / "detections.json").unlink()
    assert main([str(dataset), "--out", str(tmp_path / "out")]) == 2
    problem = capsys.readouterr().err
    for flag in ("detector", "--detections FILE", "--detector NAME", "--annotations FILE"):
        assert flag in problem


def test_of_pictures_of_several_episodes_a_single_one_takes_its_own(rooms, tmp_path):
    from labeling.formats.checked_json import Json
    from labeling.io.coco import read_shared_file

    room = rooms[0]

    def categories_of(*names: str) -> list[str]:
        images = [{"id": n, "file_name": name} for n, name in enumerate(names)]
        categories = [{"id": n, "name": f"of {name}"} for n, name in enumerate(names)]
        outline = [[2, 3, 7, 3, 7, 9, 2, 9]]
        annotations = [{"image_id": n, "category_id": n, "segmentation": outline} for n in range(len(names))]
        content = {"images": images, "categories": categories, "annotations": annotations}
        return [one.category for one in read_shared_file(Json(content, tmp_path), room, ".", scored=False)[0]]

    first, second = room.file_names[:2]
    own, other = f"{room.name}/{first}", f"bath/{first}"
    assert categories_of(own, other) == [f"of {own}"]
    assert categories_of(other, f"x/{own}") == [f"of x/{own}"]
    assert categories_of(f"bath/{first}", f"bath/{second}") == [f"of bath/{first}", f"of bath/{second}"]
    with pytest.raises(EpisodeFormatError, match=f"'bath/{first}' and 'hall/{first}' may both be '{first}'; give"):
        categories_of(other, f"hall/{first}")
    with pytest.raises(EpisodeFormatError, match="may both be"):
        categories_of(own, f"x/{own}")


def test_a_bare_file_name_that_two_views_share_names_neither(rooms, tmp_path):
    from labeling.formats.checked_json import Json
    from labeling.io.coco import read_shared_file

    room = replace(rooms[0], file_names=("a/1.png", "b/1.png", "b/2.png", "b/3.png"))
    images = [{"id": n, "file_name": name} for n, name in enumerate(["1.png", "b/1.png", "x/b/2.png", "3.png"])]
    annotations = [
        {"image_id": n, "category_id": 1, "segmentation": [[2, 3, 7, 3, 7, 9, 2, 9]]} for n in range(len(images))
    ]
    file = Json({"images": images, "categories": [{"id": 1, "name": "cup"}], "annotations": annotations}, tmp_path)
    found, _ = read_shared_file(file, room, ".", scored=False)
    assert [one.view_index for one in found] == [1, 2, 3]
    inside, notes = read_shared_file(file, room, "room", scored=False)
    assert inside == ()
    assert notes
    with pytest.raises(EpisodeFormatError, match="score"):
        read_shared_file(file, room, ".", scored=True)
