"""Splatting against a loop over pixels and points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from labeling.core.geometry import intrinsics_from_fov, look_at, project, unproject_depth
from labeling.core.splatting import silhouettes, splat
from labeling.core.views import Camera

INTRINSICS = intrinsics_from_fov(40, 30, 1.2)
POSE = look_at(np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.2, 0.8]))


def cloud(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform([-1, -2, -1], [5, 2, 3], (count, 3)).astype(np.float32)


def splat_by_loops(points: np.ndarray, camera: Camera, point_size_m: float) -> np.ndarray:
    """Every pixel asks every point whether its square covers it, and takes the nearest, then the first."""
    pixels, depth_m = project(points, camera.intrinsics, camera.camera_to_world)
    index_map = np.full(camera.size, -1)
    for v, u in np.ndindex(*camera.size):
        nearest = np.float32(np.inf)
        for i in np.flatnonzero(depth_m > point_size_m):
            half_px = 0.5 * point_size_m * np.diag(camera.intrinsics)[:2] / depth_m[i]
            own = np.floor(pixels[i] + 0.5)
            # A square that holds no pixel centre in a row or column covers the one its own centre falls into.
            low, high = np.ceil(pixels[i] - half_px), np.floor(pixels[i] + half_px)
            low, high = np.where(low > high, own, low), np.where(low > high, own, high)
            if np.all((low <= (u, v)) & ((u, v) <= high)) and np.float32(depth_m[i]) < nearest:
                index_map[v, u], nearest = i, np.float32(depth_m[i])
    return index_map


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 25),
    point_size_m=st.sampled_from([0.0, 0.05, 0.3, 1.0]),
    coarse=st.booleans(),
    kind=st.sampled_from([np.float32, np.float64]),
)
def test_splat_agrees_with_loops(seed, count, point_size_m, coarse, kind):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-2, -2, -0.5], [2, 2, 4], (count, 3)).astype(kind)
    if coarse:  # many points at one place and at one depth: ties
        points = np.rint(points)
    camera = Camera(intrinsics_from_fov(11, 8, 1.4), np.eye(4), (8, 11))
    np.testing.assert_array_equal(splat(points, camera, point_size_m), splat_by_loops(points, camera, point_size_m))


def test_splat_of_nothing_is_empty():
    assert (splat(np.zeros((0, 3)), Camera(np.eye(3), np.eye(4), (3, 4)), 0.1) == -1).all()


def test_of_two_points_on_a_ray_the_nearer_is_drawn() -> None:
    points = np.array([[4.0, 0.2, 0.8], [2.0, 0.1, 0.9], [3.0, 0.15, 0.85]], np.float32)
    index = splat(points, Camera(INTRINSICS, POSE, (30, 40)), 0.5)
    assert index[15, 20] == 1


def test_points_cover_squares_of_their_size() -> None:
    point = np.array([[3.0, 0.2, 0.8]], np.float32)
    depth = project(point.astype(float), INTRINSICS, POSE)[1][0]
    side = 0.6 * INTRINSICS[0, 0] / depth
    covered = np.count_nonzero(splat(point, Camera(INTRINSICS, POSE, (30, 40)), 0.6) == 0)
    assert (side - 1) ** 2 <= covered <= (side + 1) ** 2


def test_hidden_objects_are_drawn_whole() -> None:
    points = np.array([[4.0, 0.26, 0.74], [2.0, 0.13, 0.87]], np.float32)
    masks = silhouettes(points, np.array([0, 1], np.int32), 2, Camera(INTRINSICS, POSE, (30, 40)), 0.4)
    assert masks[0].any()
    assert masks[1].any()
    assert np.any(masks[0] & masks[1])


def test_points_without_object_and_points_behind_are_not_drawn() -> None:
    points = np.array([[3.0, 0.2, 0.8], [-3.0, 0.0, 1.0]], np.float32)
    assert not silhouettes(points, np.array([-1, 0], np.int32), 1, Camera(INTRINSICS, POSE, (30, 40)), 0.3).any()
    assert np.all(splat(points[1:], Camera(INTRINSICS, POSE, (30, 40)), 0.3) == -1)


def test_squares_over_the_border_are_cut_there() -> None:
    size = (30, 40)
    for seed in range(20):
        points = cloud(50, seed)
        big = splat(points, Camera(INTRINSICS, POSE, size), 1.5)
        assert big.shape == size
        assert big.max() < 50


def reproject(depth_m, mask, source, target):
    """The pixels of a mask of one view in another one, with a z-buffer over the whole view."""
    points, flat = unproject_depth(depth_m, source.intrinsics, source.camera_to_world)
    index = splat(points, target)
    return (index >= 0) & mask.ravel()[flat[index]]


@given(st.integers(0, 2**32 - 1))
def test_reproject_to_the_same_view_returns_the_mask_where_there_is_depth(seed):
    rng = np.random.default_rng(seed)
    camera_to_world = np.eye(4)
    camera_to_world[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    camera_to_world[:3, 3] = rng.uniform(-10, 10, 3)
    camera = Camera(intrinsics_from_fov(12, 9, 1.3), camera_to_world, (9, 12))
    depth_m = np.where(rng.random((9, 12)) < 0.2, 0, rng.uniform(0.3, 6, (9, 12)))
    mask = rng.random((9, 12)) < 0.5
    moved = reproject(depth_m, mask, camera, camera)
    np.testing.assert_array_equal(moved, mask & (depth_m > 0))


def test_reproject_hides_what_stands_behind():
    """A wall at 2 m and a post at 1 m: seen from the side the post covers other pixels of the wall."""
    depth_m = np.full((1, 9), 2.0)
    depth_m[0, 4] = 1.0
    intrinsics = np.array([[4.0, 0, 4], [0, 4.0, 0], [0, 0, 1]])
    aside = np.eye(4)
    aside[0, 3] = 0.5  # 0.5 m to the right: the wall moves 1 pixel to the left, the post 2
    here, there = Camera(intrinsics, np.eye(4), (1, 9)), Camera(intrinsics, aside, (1, 9))
    wall = depth_m == 2.0
    assert reproject(depth_m, ~wall, here, there).tolist() == [[i == 2 for i in range(9)]]
    # The wall's pixel 3 lands behind the post; what would now show at 3 stood behind the post before.
    assert reproject(depth_m, wall, here, there).tolist() == [[i in (0, 1, 4, 5, 6, 7) for i in range(9)]]


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 20),
    point_size_m=st.sampled_from([0.05, 0.3, 1.0]),
    measured=st.booleans(),
)
def test_silhouettes_agree_with_points_drawn_one_by_one(seed, count, point_size_m, measured):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-2, -2, -0.5], [2, 2, 4], (count, 3)).astype(np.float32)
    owner = rng.integers(-1, 2, count).astype(np.int32)
    camera = Camera(intrinsics_from_fov(11, 8, 1.4), np.eye(4), (8, 11))
    depth_m = rng.choice([0.0, np.nan, 0.5, 2.0, 3.9], camera.size).astype(np.float32)
    expected = np.zeros((2, *camera.size), bool)
    for point, one in zip(points, owner, strict=True):
        if one >= 0:
            covered = splat(point[None], camera, point_size_m) == 0
            hidden = (depth_m == 0) | np.isnan(depth_m) | (depth_m <= np.float32(point[2] - point_size_m))
            expected[one] |= covered & hidden if measured else covered
    rows = np.zeros((2, camera.size[0]), bool)
    drawn = silhouettes(points, owner, 2, camera, point_size_m, rows, depth_m if measured else None)
    np.testing.assert_array_equal(drawn, expected)
    np.testing.assert_array_equal(rows, expected.any(axis=2))
