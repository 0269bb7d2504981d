import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.boxes3d import fit_box
from labeling.generator.cloud.connected_components import detached_points


def box_surface(extent, yaw: float, centre, count: int = 4000, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = rng.choice([-0.5, 0.5], count)
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return (points * extent) @ turn.T + centre


@settings(max_examples=30)
@given(st.floats(0, np.pi), st.floats(0.3, 0.9), st.floats(0.2, 2.0), st.integers(0, 100))
def test_the_box_of_a_box_is_itself(yaw: float, ratio: float, height: float, seed: int) -> None:
    extent, centre = np.array([1.0, ratio, height]), np.array([3.0, -2.0, 0.7])
    box = fit_box(box_surface(extent, yaw, centre, seed=seed), trim=0.0)
    assert box is not None
    np.testing.assert_allclose(box.extent_m, extent, rtol=0.05)
    np.testing.assert_allclose(box.centre_m, centre, atol=0.03)
    long_side = np.array([np.cos(yaw), np.sin(yaw), 0])
    assert abs(box.rotation[:, 0] @ long_side) > 0.99
    np.testing.assert_allclose(box.rotation @ box.rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(box.rotation) == pytest.approx(1)
    np.testing.assert_allclose(box.rotation[:, 2], [0, 0, 1])


def two_sides(extent, yaw: float, centre, thick_m: float, count: int = 3000, seed: int = 0) -> np.ndarray:
    """What an observer beyond a corner sees of a box with points within ``thick_m`` of its surface: two sides."""
    points = box_surface(extent, 0.0, np.zeros(3), 4 * count, seed)
    facing = (points[:, 0] > 0.5 * extent[0] - 1e-9) | (points[:, 1] > 0.5 * extent[1] - 1e-9)
    shown = points[facing][:count] - np.random.default_rng(seed).uniform(0, thick_m, (min(count, facing.sum()), 3))
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    return shown @ turn.T + centre


@settings(max_examples=40)
@given(st.floats(0, np.pi), st.floats(0.35, 1.0), st.floats(0.0, 0.05), st.integers(0, 100))
def test_a_box_of_which_two_sides_were_seen_is_the_whole_box(yaw: float, ratio: float, thick: float, seed: int) -> None:
    """The hull of its footprint is a triangle, on each of whose sides lies a rectangle of the same area."""
    extent, centre = np.array([4.0, 4.0 * ratio, 1.5]), np.array([3.0, -2.0, 0.7])
    box = fit_box(two_sides(extent, yaw, centre, thick, seed=seed), trim=0.0)
    assert box is not None
    np.testing.assert_allclose(box.extent_m, extent, atol=0.1)
    np.testing.assert_allclose(box.centre_m, centre, atol=0.1)
    side = np.array([np.cos(yaw), np.sin(yaw), 0])
    assert np.max(np.abs(box.rotation[:, :2].T @ side)) > np.cos(np.radians(2.0))


def test_few_strays_hardly_grow_the_box() -> None:
    points = box_surface(np.array([1.0, 0.5, 0.8]), 0.4, np.zeros(3))
    strays = np.random.default_rng(0).uniform(-3, 3, (12, 3))
    box = fit_box(np.concatenate([points, strays]))
    assert box is not None
    np.testing.assert_allclose(box.extent_m, [1.0, 0.5, 0.8], rtol=0.15)


@pytest.mark.parametrize("points", [[[1, 2, 3]], [[0, 0, 0], [1, 1, 0]], [[0, 0, 0], [0, 0, 1], [0, 0, 2]]])
def test_few_or_flat_points_have_a_box(points) -> None:
    box = fit_box(np.array(points, float), trim=0.0, margin_m=0.1)
    assert box is not None
    assert np.all(box.extent_m >= 0.1 - 1e-9)
    local = (np.array(points) - box.centre_m) @ box.rotation
    assert np.all(np.abs(local) <= 0.5 * box.extent_m + 1e-6)


def test_no_points_have_no_box() -> None:
    assert fit_box(np.zeros((0, 3))) is None


def test_small_pieces_far_from_the_object_are_strays() -> None:
    body = np.random.default_rng(0).uniform(0, 1, (1000, 3)).astype(np.float32)
    far = np.random.default_rng(1).uniform(3, 3.1, (10, 3)).astype(np.float32)
    half = np.random.default_rng(2).uniform(5, 6, (900, 3)).astype(np.float32)
    points = np.concatenate([body, far, half])
    strays = detached_points(points, np.zeros(1910, np.int32), 1, gap_m=0.2, min_share=0.05)
    np.testing.assert_array_equal(np.flatnonzero(strays), np.arange(1000, 1010))


def lump(low, high, number: int) -> np.ndarray:
    return np.random.default_rng(number).uniform(low, high, (number, 3)).astype(np.float32)


def test_pieces_out_of_reach_of_the_body_are_strays_whatever_their_size() -> None:
    body, behind_a_pole = lump([0, 0, 0], [2, 1, 1], 2000), lump([2.3, 0, 0], [3, 1, 1], 900)
    beyond = lump([4, 0, 0], [5, 1, 1], 800)  # 1 m from the piece that is part of the body: .15 * 2.45 m is .37 m
    points, owner = np.concatenate([body, behind_a_pole, beyond]), np.zeros(3700, np.int32)
    for reach, gone in ((np.inf, 0), (0.15, 800), (0.1, 1700), (0.42, 0)):
        strays = detached_points(points, owner, 1, gap_m=0.2, min_share=0.05, reach=reach)
        np.testing.assert_array_equal(np.flatnonzero(strays), np.arange(3700 - gone, 3700))


def test_the_body_is_what_detections_speak_for_not_what_is_largest() -> None:
    lawn, car = lump([10, 10, 0], [20, 20, 0.1], 20_000), lump([0, 0, 0], [4, 2, 1.5], 700)
    points, owner = np.concatenate([lawn, car]), np.zeros(20_700, np.int32)
    support = np.where(np.arange(20_700) < 20_000, 0.001, 0.9).astype(np.float32)
    strays = detached_points(points, owner, 1, gap_m=0.6, min_share=0.05, reach=0.15, support=support)
    np.testing.assert_array_equal(strays, np.arange(20_700) < 20_000)
    by_size = detached_points(points, owner, 1, gap_m=0.6, min_share=0.05, reach=0.15)
    np.testing.assert_array_equal(by_size, ~strays)


def test_points_of_no_object_and_of_others_are_not_judged_together() -> None:
    points = np.array([[0, 0, 0], [0.1, 0, 0], [9, 9, 9], [5, 5, 5]], np.float32)
    strays = detached_points(points, np.array([0, 0, 1, -1], np.int32), 2, gap_m=0.2, min_share=0.9)
    assert not strays.any()
