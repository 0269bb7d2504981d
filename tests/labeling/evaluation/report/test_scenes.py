"""Scenes as the report's page has them: few points, evenly spread, where the cloud has them."""

import base64
import json
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from labeling.core.types import Box3d
from labeling.evaluation.report.scenes import AROUND, pack_scenes, thinned
from labeling.inspection.scene import LabelledScene, SceneObject, TrueObject

BOX = Box3d(np.array([500_000.0, 30.0, 0.5]), np.array([1.0, 1.0, 1.0]), np.eye(3))


def scene(count: int = 500) -> LabelledScene:
    rng = np.random.default_rng(5)
    points = BOX.centre_m + rng.uniform(-3, 3, (count, 3))
    points[:10] = BOX.corners().mean(axis=0)
    labels = np.zeros(count, np.int32)
    labels[:10] = 1
    one = SceneObject(1, "1 chair 0.90", BOX, (1.0, 0.0, 0.0), "chair", 0.9, 7, (0,), "")
    truth = (TrueObject("chair", BOX),)
    return LabelledScene(
        "a", points, rng.integers(0, 255, (count, 3)).astype(np.uint8), labels, (one,), (), None, truth
    )


@settings(max_examples=30)
@given(st.integers(1, 3000), st.integers(1, 3000))
def test_thinning_keeps_few_points_and_leaves_no_hole(count: int, most: int) -> None:
    points = np.random.default_rng(count).uniform(0, 4, (count, 3))
    kept = thinned(points, most)
    assert 0 < len(kept) <= most
    assert len(np.unique(kept)) == len(kept)
    if count <= most:
        assert len(kept) == count
    else:
        nearest_m, _ = KDTree(points[kept]).query(points)
        side_m = 4 * (most / 8) ** (-1 / 3)  # a cell in each direction of a grid of an eighth of the points
        assert nearest_m.max() <= np.sqrt(3) * side_m


def test_points_are_where_the_cloud_has_them_however_far_from_the_origin() -> None:
    made = scene()
    (packed,) = pack_scenes([made])
    places = np.frombuffer(base64.b64decode(packed["points"]), "<u2").reshape(-1, 3)
    numbers = np.frombuffer(base64.b64decode(packed["numbers"]), "<u2")
    corner = np.array(packed["objects"][0]["corners"]).reshape(8, 3)
    low = BOX.corners()[0] - corner[0]  # what the page takes for the origin
    points = low + packed["scale"] * places
    apart_m, _ = KDTree(made.points).query(points)
    assert len(points) == packed["count"] == len(numbers)
    assert apart_m.max() < 2e-3
    assert (numbers == 1).sum() == 10
    reach_m = 0.5 + AROUND
    assert np.abs(points - BOX.centre_m).max() <= reach_m + 2e-3
    assert packed["truth"][0]["corners"] == packed["objects"][0]["corners"]


def test_episodes_without_a_cloud_are_left_out() -> None:
    empty = LabelledScene("e", np.zeros((0, 3)), np.zeros((0, 3), np.uint8), np.zeros(0, np.int32), (), ())
    assert [one["name"] for one in pack_scenes([empty, scene()])] == ["a"]
    assert pack_scenes([]) == []


def test_points_that_are_nowhere_are_left_out() -> None:
    made = scene()
    points = made.points.copy()
    points[20:30], points[30:40], points[:3] = np.nan, np.inf, 1e30  # the last ones are of the object
    (packed,) = pack_scenes([replace(made, points=points)])
    (whole,) = pack_scenes([made])
    assert 0 < packed["count"] <= whole["count"] - 3
    assert packed["scale"] < 1e-3
    json.dumps(packed, allow_nan=False)
