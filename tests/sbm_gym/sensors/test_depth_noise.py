"""Noise of depth follows the formulas that it is said to follow."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labeling.core.geometry import intrinsics_from_fov
from sbm_gym.sensors import depth_noise
from sbm_gym.sensors.depth_noise import (
    KINECT_BASELINE_M,
    KINECT_FOCAL_PX,
    in_shadow,
    incidence_cosine,
    jumps,
    kinect,
    lidar,
    quantised,
    sense_depth,
    stereo,
)
from sbm_gym.sensors.noise_config import Sensor

SENSORS = ("kinect", "stereo", "lidar")
K = intrinsics_from_fov(160, 120, np.deg2rad(60))


def wall(distance_m: float, size: tuple[int, int] = (120, 160)) -> np.ndarray:
    """A wall met head-on."""
    return np.full(size, distance_m, np.float32)


def tilted_wall(distance_m: float, angle_rad: float) -> np.ndarray:
    """A wall whose normal is turned about the vertical axis by an angle."""
    across = (np.arange(160) - K[0, 2]) / K[0, 0]
    row = distance_m / (1 - np.tan(angle_rad) * across)
    return np.tile(row, (120, 1)).astype(np.float32)


def two_walls(near_m: float, far_m: float, columns: slice) -> np.ndarray:
    depth_m = wall(far_m)
    depth_m[:, columns] = near_m
    return depth_m


@pytest.mark.parametrize("distance_m", [0.8, 1.5, 3.0, 4.5])
def test_a_kinects_noise_grows_with_the_square_of_distance(distance_m):
    error_m = kinect(wall(distance_m), K, np.random.default_rng(0)) - distance_m
    step_m = distance_m**2 / (8 * KINECT_FOCAL_PX * KINECT_BASELINE_M)
    # Rounding to whole steps adds the variance of a uniform distribution, step²/12.
    expected_m = np.hypot(0.0012 + 0.0019 * (distance_m - 0.4) ** 2, step_m / np.sqrt(12))
    assert error_m.std() == pytest.approx(expected_m, rel=0.1)
    assert abs(error_m.mean()) < 0.1 * expected_m


def test_a_kinect_tells_whole_eighths_of_a_pixel():
    measured = kinect(wall(2.3), K, np.random.default_rng(0))
    disparity_px = KINECT_FOCAL_PX * KINECT_BASELINE_M / measured[measured > 0].astype(float)
    np.testing.assert_allclose(8 * disparity_px, np.rint(8 * disparity_px), atol=1e-3)


@pytest.mark.parametrize("distance_m", [1.0, 2.5, 5.0])
def test_the_noise_of_stereo_is_that_of_its_disparities(distance_m):
    measured = stereo(wall(distance_m), K, np.random.default_rng(0)).astype(float)
    error_px = 455 * 0.05 * (1 / measured - 1 / distance_m)
    assert error_px.std() == pytest.approx(np.hypot(0.1, 1 / 32 / np.sqrt(12)), rel=0.05)


def test_neighbours_in_a_stereo_picture_err_alike():
    error_m = stereo(wall(3.0), K, np.random.default_rng(0)) - 3
    assert np.corrcoef(error_m[:, :-1].ravel(), error_m[:, 1:].ravel())[0, 1] > 0.2
    independent = lidar(wall(3.0), K, np.random.default_rng(0)) - 3
    assert abs(np.corrcoef(independent[:, :-1].ravel(), independent[:, 1:].ravel())[0, 1]) < 0.05


def test_objects_grow_in_stereo_and_lose_a_side():
    true = two_walls(1.0, 3.0, slice(70, 90))
    measured = stereo(true, K, np.random.default_rng(0))[60]
    # A window of seven of the sensor's pixels is three of these, so that objects grow by one.
    np.testing.assert_allclose(measured[[68, 69, 70]], [3, 1, 1], rtol=0.05)
    hidden = np.flatnonzero(measured[90:110] == 0)
    assert len(hidden) == pytest.approx(K[0, 0] * 0.05 * (1 / 1.0 - 1 / 3.0), abs=1)


@pytest.mark.slow
@pytest.mark.parametrize("distance_m", [2.0, 10.0, 25.0])
def test_lidar_has_one_noise_at_all_ranges_and_loses_pulses_by_the_law_of_speckle(distance_m):
    measured = lidar(wall(distance_m, (400, 400)), np.diag([1e6, 1e6, 1.0]), np.random.default_rng(0))
    returned = measured[measured > 0]
    assert returned.std() == pytest.approx(0.01, rel=0.05)
    # Strength falls with the square of range, and is distributed exponentially around that.
    assert len(returned) / measured.size == pytest.approx(np.exp(-((distance_m / 20) ** 2)), abs=0.01)


def test_lidar_puts_points_into_mid_air_at_edges():
    measured = lidar(two_walls(1.0, 3.0, slice(70, 90)), K, np.random.default_rng(0))
    between = (measured > 1.2) & (measured < 2.8)
    assert set(np.flatnonzero(between.any(axis=0))) == {69, 70, 89, 90}


@pytest.mark.parametrize("angle_deg", [-55, -40, 0, 25, 50])
def test_the_angle_of_incidence_is_that_of_the_wall(angle_deg):
    angle_rad = np.deg2rad(angle_deg)
    cosine = incidence_cosine(tilted_wall(2.0, angle_rad), K)
    x = (np.arange(160) - K[0, 2]) / K[0, 0]
    y = (np.arange(120) - K[1, 2]) / K[1, 1]
    normal = np.array([np.sin(angle_rad), 0, -np.cos(angle_rad)])
    rays = np.stack([*np.meshgrid(x, y), np.ones((120, 160))], axis=-1)
    expected = np.abs(rays @ normal) / np.linalg.norm(rays, axis=-1)
    np.testing.assert_allclose(cosine, expected, atol=0.02)


def test_what_is_grazed_gives_nothing_to_a_kinect_and_no_wall_is_an_edge():
    steep = tilted_wall(2.0, np.deg2rad(84))
    seen = (steep > 0) & (steep < 9)
    assert not jumps(tilted_wall(2.0, np.deg2rad(55)))[:, 1:-1].any()
    grazed = seen & (incidence_cosine(steep, K) < np.cos(np.deg2rad(83)))
    assert grazed.any()
    assert not kinect(steep, K, np.random.default_rng(0))[grazed].any()


@pytest.mark.parametrize(("near_m", "far_m"), [(1.0, 2.0), (0.7, 5.0)])
def test_the_shadow_is_as_wide_as_the_disparities_differ(near_m, far_m):
    """A projector to the left of the camera lights nothing on the right side behind an object."""
    hidden = in_shadow(two_walls(near_m, far_m, slice(40, 60)), 10.0)
    (columns,) = np.nonzero(hidden[0])
    assert columns[0] == 60
    assert len(columns) == pytest.approx(10 / near_m - 10 / far_m, abs=1)
    assert np.array_equal(hidden, np.tile(hidden[0], (120, 1)))


def test_edges_cost_a_kinect_half_of_their_pixels():
    true = two_walls(2.0, 2.4, slice(60, 160))  # nothing is in shadow: the nearer wall reaches to the right
    beside = kinect(true, K, np.random.default_rng(0))[:, 59:61]
    assert np.mean(beside == 0) == pytest.approx(0.5, abs=0.1)


DEPTHS = arrays(np.float32, (9, 11), elements=st.just(0.0) | st.floats(2.0**-10, 60.0, width=32))


@settings(max_examples=60)
@given(DEPTHS, st.sampled_from(SENSORS), st.integers(0, 2**32 - 1))
def test_any_depth_stays_depth(depth_m, sensor, seed):
    """Nothing appears where nothing was, all is finite, and the same seed gives the same."""
    k = intrinsics_from_fov(11, 9, 1.2)
    found = sense_depth(sensor, depth_m, k, np.random.default_rng(seed))
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    assert not found[depth_m == 0].any()
    np.testing.assert_array_equal(found, sense_depth(sensor, depth_m, k, np.random.default_rng(seed)))
    assert sense_depth("ideal", depth_m, k, np.random.default_rng(seed)) is depth_m


@settings(max_examples=60)
@given(DEPTHS, st.floats(1e-4, 0.1))
def test_rounding_of_inverses_is_idempotent_and_within_half_a_step(depth_m, step_per_m):
    once = quantised(depth_m, step_per_m)
    kept = once > 0
    assert np.abs(1 / once[kept] - 1 / depth_m[kept].astype(float)).max(initial=0) <= 0.5 * step_per_m + 1e-9
    np.testing.assert_allclose(quantised(once, step_per_m), once, rtol=1e-9)


def test_every_sensor_has_its_function():
    assert {"ideal", *depth_noise._SENSORS} == set(get_args(Sensor))
