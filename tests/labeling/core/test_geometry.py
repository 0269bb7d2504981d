"""Laws of cameras and transforms."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from labeling.core.geometry import (
    OPENGL_TO_OPENCV,
    flip_camera_axes,
    intrinsics_from_fov,
    invert_rigid,
    is_rigid,
    look_at,
    project,
    transform_points,
    unproject,
    unproject_depth,
)


def metres(low: float, high: float):
    return st.floats(low, high, allow_nan=False, width=64)


@st.composite
def rigid_transforms(draw):
    """Rotation by a random quaternion, translation by up to 10 m."""
    w, x, y, z = (draw(metres(-1, 1)) for _ in range(4))
    norm = np.sqrt(w * w + x * x + y * y + z * z)
    assume(norm > 0.1)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    transform = np.eye(4)
    transform[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    transform[:3, 3] = [draw(metres(-10, 10)) for _ in range(3)]
    return transform


@st.composite
def cameras(draw):
    """Intrinsics whose focal lengths and principal point are anywhere plausible."""
    return np.array(
        [
            [draw(metres(5, 800)), 0.0, draw(metres(-20, 300))],
            [0.0, draw(metres(5, 800)), draw(metres(-20, 300))],
            [0.0, 0.0, 1.0],
        ]
    )


def points_of(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-5, 5, (count, 3))


@given(cameras(), rigid_transforms(), st.integers(0, 2**32 - 1))
def test_project_after_unproject_returns_pixels_and_depth(intrinsics, camera_to_world, seed):
    rng = np.random.default_rng(seed)
    pixels, depth_m = rng.uniform(-10, 500, (20, 2)), rng.uniform(0.05, 50, 20)
    back, back_depth_m = project(unproject(pixels, depth_m, intrinsics, camera_to_world), intrinsics, camera_to_world)
    np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-4)
    np.testing.assert_allclose(back_depth_m, depth_m, rtol=0, atol=1e-9)


@given(cameras(), rigid_transforms(), st.integers(0, 2**32 - 1))
def test_project_agrees_with_homogeneous_matrices(intrinsics, camera_to_world, seed):
    points = points_of(seed, 20)
    homogeneous = (intrinsics @ np.linalg.inv(camera_to_world)[:3] @ np.c_[points, np.ones(20)].T).T
    pixels, depth_m = project(points, intrinsics, camera_to_world)
    np.testing.assert_allclose(depth_m, homogeneous[:, 2], atol=1e-9)
    before = homogeneous[:, 2] > 1e-3
    np.testing.assert_allclose(pixels[before], (homogeneous[:, :2] / homogeneous[:, 2:])[before], rtol=1e-6, atol=1e-4)
    assert np.isnan(pixels[depth_m <= 0]).all()


@given(rigid_transforms(), rigid_transforms(), st.integers(0, 2**32 - 1))
def test_rigid_transforms_compose_and_stay_rigid(a, b, seed):
    points = points_of(seed, 10)
    assert is_rigid(a @ b)
    np.testing.assert_allclose(
        transform_points(a @ b, points), transform_points(a, transform_points(b, points)), atol=1e-9
    )


@given(rigid_transforms())
def test_invert_rigid_undoes_and_agrees_with_matrix_inverse(transform):
    np.testing.assert_allclose(invert_rigid(transform) @ transform, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(invert_rigid(transform), np.linalg.inv(transform), atol=1e-9)


@given(rigid_transforms())
def test_flip_camera_axes_is_its_own_inverse_and_keeps_transforms_rigid(camera_to_world):
    flipped = flip_camera_axes(camera_to_world)
    assert is_rigid(flipped)
    np.testing.assert_array_equal(flip_camera_axes(flipped), camera_to_world)
    np.testing.assert_array_equal(flipped[:, 3], camera_to_world[:, 3])
    # What was ahead (+Z) in one convention is ahead (-Z) in the other; down (+Y) is down (-Y).
    np.testing.assert_array_equal(flipped[:3, 2], -camera_to_world[:3, 2])
    np.testing.assert_array_equal(flipped[:3, 1], -camera_to_world[:3, 1])


def test_flip_camera_axes_takes_stacks():
    stack = np.stack([np.eye(4), OPENGL_TO_OPENCV])
    np.testing.assert_array_equal(flip_camera_axes(stack), np.stack([OPENGL_TO_OPENCV, np.eye(4)]))


@given(rigid_transforms(), st.integers(0, 15), st.sampled_from([np.nan, np.inf, 1e6, 3.0]))
def test_is_rigid_refuses_any_spoiled_entry_but_a_translation(transform, position, value):
    spoiled = transform.copy()
    spoiled.flat[position] = value
    moves_only = position in (3, 7, 11) and np.isfinite(value)
    assert is_rigid(spoiled) == moves_only


def test_is_rigid_refuses_mirrors_and_scales():
    assert not is_rigid(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert not is_rigid(np.diag([1.1, 1.1, 1.1, 1.0]))


def test_transform_points_keeps_single_precision():
    assert transform_points(np.eye(4), np.ones((2, 3), np.float32)).dtype == np.float32


@given(metres(0.1, 3.0), st.integers(1, 700), st.integers(1, 700))
def test_intrinsics_from_fov_span_the_field_of_view_edge_to_edge(fov_rad, width_px, height_px):
    intrinsics = intrinsics_from_fov(width_px, height_px, fov_rad)
    edges = np.array([[-0.5, (height_px - 1) / 2], [width_px - 0.5, (height_px - 1) / 2]])
    left, right = unproject(edges, np.ones(2), intrinsics, np.eye(4))
    angle = np.arctan2(right[0], right[2]) - np.arctan2(left[0], left[2])
    assert angle == pytest.approx(fov_rad, abs=1e-9)


@given(st.tuples(*[metres(-5, 5)] * 3), st.tuples(*[metres(-5, 5)] * 3))
def test_look_at_puts_the_target_in_the_middle_and_up_up(eye, target):
    eye, target = np.array(eye), np.array(target)
    assume(np.linalg.norm((target - eye)[:2]) > 1e-2)
    camera_to_world = look_at(eye, target)
    assert is_rigid(camera_to_world)
    np.testing.assert_array_equal(camera_to_world[:3, 3], eye)
    pixels, depth_m = project(target[None], intrinsics_from_fov(101, 51, 1.0), camera_to_world)
    np.testing.assert_allclose(pixels[0], [50, 25], atol=1e-5)
    assert depth_m[0] == pytest.approx(np.linalg.norm(target - eye))
    assert camera_to_world[2, 0] == pytest.approx(0, abs=1e-12)  # the horizon is level
    assert camera_to_world[2, 1] < 0  # the camera's down points down


@pytest.mark.parametrize("target", [(0, 0, 1), (0, 0, 3), (0, 0, -4)])
def test_look_at_refuses_directions_without_heading(target):
    with pytest.raises(ValueError, match="look_at"):
        look_at(np.array([0.0, 0.0, 1.0]), np.array(target, float))


@given(rigid_transforms(), st.integers(0, 2**32 - 1))
def test_unproject_depth_agrees_with_a_loop(camera_to_world, seed):
    rng = np.random.default_rng(seed)
    depth_m = np.where(rng.random((4, 5)) < 0.4, 0, rng.uniform(0.2, 9, (4, 5)))
    intrinsics = intrinsics_from_fov(5, 4, 1.2)
    expected = []
    for y in range(4):
        for x in range(5):
            if depth_m[y, x] > 0:
                ray = np.linalg.inv(intrinsics) @ [x, y, 1]
                expected.append((*(camera_to_world @ [*(ray * depth_m[y, x]), 1])[:3], y * 5 + x))
    points, flat = unproject_depth(depth_m, intrinsics, camera_to_world)
    table = np.array(expected).reshape(-1, 4)
    np.testing.assert_allclose(points, table[:, :3], atol=1e-9)
    assert flat.tolist() == table[:, 3].astype(int).tolist()
