import json
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from labeling.core.episode_labels import EpisodeLabels, IgnoredRegion, LabelledObject, SegmentedCloud, Source
from labeling.core.types import Box3d, PseudoLabel
from labeling.formats.atomic import write_json
from labeling.io.label_records import (
    EpisodeRecord,
    LabelRecord,
    ObjectRecord,
    as_json,
    episode_record,
    read_record,
)

from ..synthetic_room import make_episode


@pytest.fixture(scope="module")
def record() -> EpisodeRecord:
    episode = make_episode(1, num_views=2, size=(24, 32), num_objects=1)
    seen, whole, none = np.zeros((3, 24, 32), bool)
    seen[3:8, 4:9], whole[3:12, 4:9] = True, True
    box = Box3d(np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0]), np.eye(3))
    chair = LabelledObject(1, "chair", 1 / 3, box, (Source(1, 0.9, "chair"),))
    labels = (
        PseudoLabel(0, 1, "chair", 2 / 3, seen, whole, 1, 0.9),
        PseudoLabel(1, 1, "chair", 0.5, none, whole, 1, 0.9),
    )
    points = np.zeros((0, 3), np.float32)
    cloud = SegmentedCloud(points, points, np.zeros(0, np.int32), np.zeros((0, 1), np.float32))
    found = EpisodeLabels((chair,), labels, cloud, None, (IgnoredRegion(1, "lamp", 0.4, seen),))
    return episode_record(episode, found, "mark", "detections.json", ["a note"])


def test_a_record_is_read_as_it_was_written(record: EpisodeRecord, tmp_path) -> None:
    write_json(tmp_path / "room.json", as_json(record))
    assert read_record(tmp_path / "room.json", "mark") == record
    assert msgspec.json.decode(json.dumps(as_json(record)), type=EpisodeRecord) == record


def test_masks_are_those_of_the_labels(record: EpisodeRecord) -> None:
    first, second = record.labels
    assert (first.modal and first.modal.area, first.amodal and first.amodal.area) == (25, 45)
    assert first.modal is not None
    assert list(first.modal.bbox) == [4, 3, 5, 5]
    assert second.modal is None
    assert record.ignored[0].instance_id is None
    assert {"chair", "lamp"} <= set(record.categories)


def test_what_stands_in_this_episode_only_says_so_and_nothing_else_does(record: EpisodeRecord) -> None:
    assert "only_here" not in as_json(record.objects[0])
    assert record.objects[0].box_3d is not None
    guest = ObjectRecord.of(LabelledObject(1, "car", 0.5, record.objects[0].box_3d, (), only_here=True))
    assert as_json(guest)["only_here"] is True
    assert msgspec.convert(as_json(guest), ObjectRecord) == guest


def test_what_is_shared_says_where_from_and_nothing_else_does(record: EpisodeRecord) -> None:
    assert "source_episode" not in as_json(record.labels[0])
    shared = replace(record.labels[0], source_episode="other")
    assert msgspec.convert(as_json(shared), LabelRecord) == shared
    one = replace(record.objects[0], shared_from={"episode": "other", "instance_id": 4})
    assert msgspec.convert(as_json(one), ObjectRecord) == one
    assert one.box_3d is not None
    np.testing.assert_array_equal(one.box_3d.extent_m, [1, 2, 3])


@pytest.mark.parametrize("text", ["", "{", "[]", '{"fingerprint": "mark"}', '{"fingerprint": "other"}'])
def test_what_cannot_be_read_is_no_record(tmp_path, text: str) -> None:
    (tmp_path / "room.json").write_text(text)
    assert read_record(tmp_path / "room.json", "mark") is None
    assert read_record(tmp_path / "absent.json", "mark") is None
