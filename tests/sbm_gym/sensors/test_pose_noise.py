"""Wrong poses are as wrong as they are said to be."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from labeling.core.geometry import is_rigid, look_at
from sbm_gym.sensors.pose_noise import drift_poses, jitter_poses

ANGLE_RAD, SHIFT_M = np.deg2rad(2.0), 0.05


@pytest.fixture
def poses() -> np.ndarray:
    angles = np.linspace(0, 6, 25)
    return np.stack([look_at(np.array([np.cos(a), 2 * np.sin(a), 1.2]), np.zeros(3)) for a in angles])


def errors(true: np.ndarray, wrong: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles between orientations, distances between positions."""
    turned = Rotation.from_matrix(np.swapaxes(true[:, :3, :3], 1, 2) @ wrong[:, :3, :3])
    return turned.magnitude(), np.linalg.norm(wrong[:, :3, 3] - true[:, :3, 3], axis=1)


def repeated(function, poses: np.ndarray, times: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Root mean squares over many seeds, view by view."""
    found = [errors(poses, function(poses, ANGLE_RAD, SHIFT_M, np.random.default_rng(seed))) for seed in range(times)]
    angles, shifts = (np.sqrt(np.mean(np.square([one[part] for one in found]), axis=0)) for part in (0, 1))
    return angles, shifts


def test_jitter_is_the_same_for_all_views(poses):
    angles, shifts = repeated(jitter_poses, poses)
    np.testing.assert_allclose(angles, ANGLE_RAD, rtol=0.1)
    np.testing.assert_allclose(shifts, SHIFT_M, rtol=0.1)


def test_drift_grows_with_the_root_of_time(poses):
    angles, shifts = repeated(drift_poses, poses)
    growth = np.sqrt(np.arange(25) / 24)
    np.testing.assert_allclose(angles, ANGLE_RAD * growth, rtol=0.1, atol=1e-7)
    np.testing.assert_allclose(shifts, SHIFT_M * growth, rtol=0.1)


def test_neighbours_drift_alike_and_jitter_apart(poses):
    drifted, jittered = (
        function(poses, 0.0, SHIFT_M, np.random.default_rng(0))[:, :3, 3] - poses[:, :3, 3]
        for function in (drift_poses, jitter_poses)
    )
    steps = [np.linalg.norm(np.diff(one, axis=0), axis=1).mean() for one in (drifted, jittered)]
    assert steps[0] < 0.3 * steps[1]


@pytest.mark.parametrize("function", [jitter_poses, drift_poses])
def test_poses_stay_rigid_and_no_error_changes_nothing(poses, function):
    assert all(is_rigid(pose, 1e-9) for pose in function(poses, 1.0, 3.0, np.random.default_rng(1)))
    np.testing.assert_array_equal(function(poses, 0.0, 0.0, np.random.default_rng(1)), poses)
    np.testing.assert_allclose(function(poses[:1], 0.0, 0.0, np.random.default_rng(1)), poses[:1])


def test_a_single_view_does_not_drift(poses):
    np.testing.assert_array_equal(drift_poses(poses[:1], 1.0, 1.0, np.random.default_rng(0)), poses[:1])
