import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.boxes3d import fit_box
from labeling.core.types import Box3d
from labeling.generator.cloud.ground import floor_height
from labeling.generator.quality.box_completion import MAX_GAP, MAX_GAP_OF_FLAT, extend_to_support

VOXEL_M = 0.04


def slab(low, high) -> np.ndarray:
    """Points of a full axis-aligned block, a voxel apart."""
    axes = [np.arange(a, b + 1e-9, VOXEL_M) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)


FLOOR = slab((-2, -2, 0), (2, 2, 0))


def standing(thing: np.ndarray, rest: np.ndarray) -> Box3d:
    points = np.concatenate([thing, rest])
    own = np.arange(len(points)) < len(thing)
    box = fit_box(thing)
    assert box is not None
    return extend_to_support(box, points, own, VOXEL_M, floor_height(points, VOXEL_M))


def bottom(box: Box3d) -> float:
    return float(box.centre_m[2] - 0.5 * box.extent_m[2])


def top(box: Box3d) -> float:
    return float(box.centre_m[2] + 0.5 * box.extent_m[2])


@pytest.mark.parametrize("height_m", [-3.0, 0.0, 1.2])
def test_the_floor_is_found_at_any_height(height_m: float) -> None:
    wall = slab((-2, 2, 0), (2, 2, 2.4))
    noise = np.random.default_rng(0).uniform([-2, -2, -1], [2, 2, 0], (20, 3))
    points = np.concatenate([FLOOR, wall, noise]).astype(np.float32) + np.array([0, 0, height_m], np.float32)
    found_m = floor_height(points, VOXEL_M)
    assert found_m is not None
    assert abs(found_m - height_m) <= VOXEL_M


def test_a_chair_without_legs_reaches_the_floor() -> None:
    seat = slab((-0.25, -0.25, 0.28), (0.25, 0.25, 0.92))
    box = standing(seat, FLOOR)
    assert bottom(box) == pytest.approx(0, abs=0.5 * VOXEL_M)
    assert top(box) == pytest.approx(0.92, abs=VOXEL_M)


def test_a_table_top_stands_on_the_floor_and_a_shelf_on_a_wall_does_not() -> None:
    assert bottom(standing(slab((-0.6, -0.4, 0.7), (0.6, 0.4, 0.75)), FLOOR)) == pytest.approx(0, abs=0.5 * VOXEL_M)
    desk = slab((-0.8, -0.3, 0.7), (0.8, 0.3, 0.75))  # higher than deep
    assert bottom(standing(desk, FLOOR)) == pytest.approx(0, abs=0.5 * VOXEL_M)
    drawer = slab((-0.8, -0.3, 0.7), (0.8, 0.3, 1.1))  # no less, but not flat
    assert bottom(standing(drawer, FLOOR)) == pytest.approx(0.7, abs=VOXEL_M)
    shelf = slab((-0.6, 1.7, 1.3), (0.6, 2.0, 1.35))
    assert bottom(standing(shelf, FLOOR)) == pytest.approx(1.3, abs=VOXEL_M)


def test_a_vase_on_a_table_stands_on_the_table() -> None:
    table = slab((-0.6, -0.4, 0.7), (0.6, 0.4, 0.75))
    vase = slab((-0.1, -0.1, 0.87), (0.1, 0.1, 1.4))
    assert bottom(standing(vase, np.concatenate([FLOOR, table]))) == pytest.approx(0.75, abs=VOXEL_M)


def test_a_picture_on_a_wall_stays_there() -> None:
    picture = slab((-0.4, 2, 1.2), (0.4, 2, 1.7))
    assert bottom(standing(picture, FLOOR)) == pytest.approx(1.2, abs=VOXEL_M)


def test_the_floor_that_nobody_saw_below_a_couch_counts() -> None:
    couch = slab((-0.8, -0.4, 0.12), (0.8, 0.4, 0.8))
    seen = FLOOR[np.any(np.abs(FLOOR[:, :2]) > [0.9, 0.5], axis=1)]
    assert bottom(standing(couch, seen)) == pytest.approx(0, abs=0.5 * VOXEL_M)


@settings(max_examples=40)
@given(st.floats(0, 2), st.floats(0.2, 1.5), st.floats(0, 1.5))
def test_boxes_only_grow_downwards_and_not_without_bounds(gap_m: float, height_m: float, yaw: float) -> None:
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    thing = (slab((-0.3, -0.2, gap_m), (0.3, 0.2, gap_m + height_m)) @ turn.T).astype(np.float32)
    fitted = fit_box(thing)
    assert fitted is not None
    box = standing(thing, FLOOR)
    assert top(box) == pytest.approx(top(fitted))
    assert np.array_equal(box.rotation, fitted.rotation)
    assert np.array_equal(box.extent_m[:2], fitted.extent_m[:2])
    most = max(MAX_GAP * fitted.extent_m[2], MAX_GAP_OF_FLAT * fitted.extent_m[:2].min())
    assert 0 < box.extent_m[2] <= fitted.extent_m[2] + most + 1e-9
    assert bottom(box) < bottom(fitted) + VOXEL_M
