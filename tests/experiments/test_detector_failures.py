import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.detector_failures import main
from experiments.pretraining.failure_figures import (
    CONDITIONS,
    EDGES,
    ObjectView,
    bin_by,
    draw_failures,
    find_objects,
    seen_from_deg,
    wilson,
)
from labeling.core.detector import stack_detections
from labeling.core.episode import Episode
from labeling.core.types import Box3d, GroundTruth


def turned(yaw: float) -> np.ndarray:
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])


@given(st.floats(-3.1, 3.1), st.floats(0.0, 3.1), st.floats(0.5, 20.0), st.floats(-1.0, 3.0))
@settings(max_examples=100)
def test_side_depends_on_the_turn_between_object_and_camera_only(yaw, side, away, height):
    box = Box3d(np.array([1.0, -2.0, 0.5]), np.ones(3), turned(yaw))
    for mirrored in (side, -side):
        # An object's front is -Y of its box.
        way = turned(yaw) @ turned(mirrored) @ [0.0, -1.0, 0.0]
        eye = box.centre_m + away * way + [0.0, 0.0, height]
        assert seen_from_deg(box, eye) == pytest.approx(np.rad2deg(side), abs=1e-6)


def test_every_object_is_in_one_bin():
    rng = np.random.default_rng(0)
    draws = rng.uniform(0, (180.0, 1.0, 49.0), (200, 3)).tolist()
    objects = [ObjectView("car", side, visible, away, found=True, confident=False) for side, visible, away in draws]
    objects += [
        ObjectView("car", 180.0, 1.0, 50.0, found=False, confident=False),
        ObjectView("car", 0.0, 0.0, 0.0, True, True),
    ]
    for condition in CONDITIONS:
        rows = bin_by(objects, condition, "outdoor")
        assert sum(row.objects for row in rows) == len(objects)
        assert sum(row.objects * (row.found or 0.0) for row in rows) == pytest.approx(201)
        assert sum(row.objects * (row.confident or 0.0) for row in rows) == pytest.approx(1)
        for row in rows:
            inside = [k for k in objects if row.low <= getattr(k, condition) < row.high]
            last = row.high == EDGES[condition]["outdoor"][-1]
            assert row.objects == len(inside) + last * sum(getattr(k, condition) == row.high for k in objects)


def test_objects_too_far_for_every_bin_are_left_out():
    rows = bin_by([ObjectView("car", 0.0, 1.0, 80.0, True, True)], "distance", "outdoor")
    assert [row.objects for row in rows] == [0] * len(rows)
    assert all(row.found is None for row in rows)


@given(st.integers(1, 500), st.floats(0.0, 1.0))
def test_wilson_intervals_hold_their_share(count, share):
    low, high = wilson(share, count)
    assert 0.0 <= low <= share + 1e-9
    assert share - 1e-9 <= high <= 1.0
    wider = wilson(share, max(count // 4, 1))
    assert wider[1] - wider[0] >= high - low - 1e-9


class OneBox:
    """Finds the left half of every picture to be a chair, more surely from view to view."""

    name, categories, batch_size, digest = "toy", ("chair", "table"), 8, ""

    def detect(self, rgb, depth_m=None):
        height, width = rgb.shape[1:3]
        mask = np.zeros((height, width), bool)
        mask[:, : width // 2] = True
        return [stack_detections([("chair", 0.5 + 0.45 * view, mask)], (height, width)) for view in range(len(rgb))]


def test_objects_in_views_tell_what_was_found_and_how_it_was_seen():
    half, all_of_it = np.zeros((8, 8), bool), np.ones((8, 8), bool)
    half[:, :4] = True
    box = Box3d(np.array([0.0, 0.0, 0.0]), np.ones(3), np.eye(3))
    poses = np.stack([np.eye(4)] * 2)
    poses[0, :3, 3], poses[1, :3, 3] = (0.0, -3.0, 0.0), (4.0, 0.0, 0.0)
    truths = (
        GroundTruth(0, 1, "chair", half, all_of_it, box),
        GroundTruth(1, 1, "chair", half, half, box),
        GroundTruth(1, 2, "table", ~half, ~half, box),
        GroundTruth(1, 3, "shelf", half, half, box),
        GroundTruth(1, 4, "chair", half, half, box, ignore=True),
    )
    episode = Episode(
        name="toy",
        rgb=np.zeros((2, 8, 8, 3), np.uint8),
        depth_m=np.ones((2, 8, 8), np.float32),
        intrinsics=np.stack([np.eye(3)] * 2),
        camera_to_world=poses,
        file_names=("0.png", "1.png"),
        ground_truth=truths,
    )
    first, second, table = find_objects(episode, OneBox())
    assert (first.side, first.visible, first.distance) == (pytest.approx(0.0), 0.5, 3.0)
    assert (second.side, second.visible, second.distance) == (pytest.approx(90.0), 1.0, 4.0)
    assert (first.found, first.confident) == (True, False)
    assert (second.found, second.confident) == (True, True)
    assert (table.category, table.found, table.confident) == ("table", False, False)


def test_the_picture_is_drawn(tmp_path):
    rng = np.random.default_rng(1)
    draws = rng.uniform(0, (180.0, 1.0, 20.0), (50, 3)).tolist()
    objects = [ObjectView("car", side, visible, away, bool(rng.random() < 0.6), False) for side, visible, away in draws]
    tables = {w: {name: bin_by(objects, name, w) for name in CONDITIONS} for w in ("indoor", "outdoor")}
    draw_failures(tables, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_unknown_detectors_are_refused_before_anything_is_recorded(tmp_path, capsys):
    views = str(tmp_path / "views")
    assert main(["--detector", "nobody", "--views.folder", views]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: unknown detector 'nobody'")
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "views").exists()
