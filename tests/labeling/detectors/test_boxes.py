"""Boxes where masks are expected: from functions, in files of detections, drawn by a person."""

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labeling.core.box_masks import mask_in_box
from labeling.core.detector import DetectorError, run_detector, stack_detections
from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.masks import box_xyxy
from labeling.core.types import Detection
from labeling.detect import main as detect
from labeling.detectors.registry import load_detector
from labeling.formats.checked_json import Json
from labeling.generate import main as generate
from labeling.io.coco import read_shared_file
from labeling.io.episodes import read_episode, write_episode

from ..synthetic_room import make_episode

DETECTOR = '''
import numpy as np

def boxes(rgb):
    return [("chair", 0.5, (2, 3, 20.5, 30)), ("plant", 0.875, np.array([30, 5, 60, 40]))]

def nearest(rgb, depth_m):
    """A box around what is nearest, and a mask of it."""
    near = (depth_m > 0) & (depth_m <= np.quantile(depth_m[depth_m > 0], 0.1))
    depth_m[:] = 0
    rows, columns = np.nonzero(near)
    box = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
    return [("box", 0.9, [float(side) for side in box]), ("mask", 0.8, near)]

def asks(rgb, depth_m="nothing given"):
    return [] if depth_m is None else 1 / 0

def inside_out(rgb):
    return [("chair", 0.6, [20, 3, 2, 30])]

def boundless(rgb):
    return [("chair", 0.6, [0, 0, float("inf"), 30])]
'''


@pytest.fixture(scope="module")
def room() -> Episode:
    return make_episode(1, num_views=3, size=(48, 64), num_objects=3, confident_share=2.0)


@pytest.fixture
def detector(tmp_path, monkeypatch) -> Iterator[str]:
    name = f"boxes_{tmp_path.name.replace('-', '_')}"
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / f"{name}.py").write_text(DETECTOR)
    monkeypatch.syspath_prepend(str(tmp_path / "code"))
    yield name
    sys.modules.pop(name, None)


def boxed(episode: Episode) -> Episode:
    """The episode as a detector of boxes would have it."""

    def of(one: Detection) -> Detection:
        box = box_xyxy(one.mask)
        mask = mask_in_box(episode.rgb[one.view_index], np.array(box, np.float32), episode.depth_m[one.view_index])
        return replace(one, mask=mask, box_xyxy=box)

    return replace(episode, detections=tuple(map(of, episode.detections or ())))


# Functions -----------------------------------------------------------------------------------------------------------


def test_a_function_may_return_boxes(detector, room):
    (found,) = load_detector(f"{detector}:boxes").detect(room.rgb[:1], room.depth_m[:1])
    assert found.categories == ("plant", "chair")
    np.testing.assert_array_equal(found.boxes_xyxy, np.array([[30, 5, 60, 40], [2, 3, 20.5, 30]], np.float32))
    for box, mask in zip(found.boxes_xyxy, found.masks, strict=True):
        np.testing.assert_array_equal(mask, mask_in_box(room.rgb[0], box, room.depth_m[0]))
    assert [one.box_xyxy for one in found.as_detections(0)] == [(30, 5, 60, 40), (2, 3, 20.5, 30)]


def test_a_function_that_asks_for_depth_gets_its_own_copy_of_it(detector, room):
    before = room.depth_m.copy()
    box, mask = run_detector(load_detector(f"{detector}:nearest"), replace(room, **one_view(room)))
    assert np.array_equal(room.depth_m, before)
    assert mask.box_xyxy is None
    assert box.box_xyxy == box_xyxy(mask.mask)
    assert box.mask.any()


def one_view(room: Episode) -> dict:
    arrays = {name: getattr(room, name)[:1] for name in ("rgb", "depth_m", "intrinsics", "camera_to_world")}
    return {**arrays, "file_names": room.file_names[:1], "detections": None, "ground_truth": None}


def test_pictures_without_depth_give_functions_none(detector, room):
    assert load_detector(f"{detector}:asks").detect(room.rgb[:1])[0].categories == ()


@pytest.mark.parametrize("function", ["inside_out", "boundless"])
def test_what_is_no_box_is_refused(detector, room, function):
    with pytest.raises(DetectorError, match=r"the box of 'chair' is \[.*\], not left, top, right, bottom in pixels"):
        run_detector(load_detector(f"{detector}:{function}"), room)


def test_boxes_that_no_mask_was_made_from_are_the_tightest_around_masks():
    masks = np.zeros((2, 8, 8), bool)
    masks[0, 2:4, 3:7] = masks[1, 1:5, 1:2] = True
    box = np.array([0, 0, 4, 6], np.float32)
    found = stack_detections([("a", 0.2, masks[0]), ("b", 0.4, masks[1])], (8, 8), {1: box})
    np.testing.assert_array_equal(found.boxes_xyxy, [box, [3, 2, 7, 4]])
    assert [one.box_xyxy for one in found.as_detections(5)] == [(0, 0, 4, 6), None]


# Files ---------------------------------------------------------------------------------------------------------------


def test_boxes_of_a_detector_come_back_from_disk_as_boxes(detector, room, tmp_path):
    write_episode(tmp_path / "room", replace(room, detections=None))
    assert detect([str(tmp_path / "room"), "--detector", f"{detector}:boxes"]) == 0
    written = json.loads((tmp_path / "room" / "detections.json").read_text())
    assert written[0]["bbox"] == [30, 5, 30, 35]
    found = read_episode(tmp_path / "room").detections
    assert found is not None
    expected = run_detector(load_detector(f"{detector}:boxes"), read_episode(tmp_path / "room"))
    assert found == expected
    assert all(one.box_xyxy for one in found)


@pytest.mark.parametrize("segmentation", [{}, {"segmentation": []}, {"segmentation": None}])
def test_results_with_boxes_only_label_as_a_detector_of_boxes_does(room, tmp_path, segmentation):
    episode = boxed(room)
    write_episode(tmp_path / "room", episode)
    path = tmp_path / "room" / "detections.json"
    assert generate([str(tmp_path / "room"), "--out", str(tmp_path / "masks")]) == 0
    bare = [
        {key: value for key, value in record.items() if key not in ("segmentation", "mask_from_box")} | segmentation
        for record in json.loads(path.read_text())
    ]
    path.write_text(json.dumps(bare))
    assert read_episode(tmp_path / "room").detections == read_episode(tmp_path / "room").detections
    assert generate([str(tmp_path / "room"), "--out", str(tmp_path / "boxes")]) == 0
    for name in ("instances_modal.json", "boxes_3d.json"):
        assert (tmp_path / "boxes" / name).read_bytes() == (tmp_path / "masks" / name).read_bytes()


def shared(room: Episode, **record: object) -> Json:
    names = room.file_names
    return Json(
        {
            "images": [{"id": k, "file_name": name} for k, name in enumerate(names)],
            "categories": [{"id": 1, "name": "cup"}],
            "annotations": [{"image_id": 1, "category_id": 1, **record}],
        },
        Path("all.json"),
    )


def test_a_persons_boxes_are_sure_but_not_exact(room):
    (found,), (note,) = read_shared_file(shared(room, bbox=[5, 6, 20, 10]), room, ".", scored=False)
    assert (found.view_index, found.confidence, found.exact) == (1, 1.0, False)
    assert note == "all.json: 1 of 1 annotations are boxes, whose masks were made here"
    assert found.mask.any()
    assert not found.mask[:, :5].any()
    (scored,), notes = read_shared_file(shared(room, bbox=[5, 6, 20, 10], score=0.7), room, ".", scored=True)
    assert (scored.box_xyxy, scored.confidence, notes) == ((5, 6, 25, 16), 0.7, ())


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({}, r"annotations\[0\]\.segmentation: is missing, and so is bbox"),
        ({"bbox": [1, 2, 3]}, r"annotations\[0\]\.bbox: must have shape \(4,\)"),
        ({"bbox": [1, 2, 0, 4]}, r"bbox: is left, top, width, height, and 0 x 4 pixels hold nothing"),
        ({"bbox": [1, 2, "3", 4]}, "bbox: must be nested lists of numbers"),
    ],
)
def test_malformed_boxes_name_file_and_field(room, record, message):
    with pytest.raises(EpisodeFormatError, match=message):
        read_shared_file(shared(room, **record), room, ".", scored=False)
