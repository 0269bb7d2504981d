"""Noise models of poses: independent errors, as of motion capture or markers, and drift, as of odometry."""

import numpy as np
from jaxtyping import Float


def jitter_poses(
    camera_to_world: Float[np.ndarray, "views 4 4"], rotation_rad: float, translation_m: float, rng: np.random.Generator
) -> Float[np.ndarray, "views 4 4"]:
    """Poses with independent errors.

    Args:
        camera_to_world: true poses.
        rotation_rad: root mean square of the angle between true and wrong orientation.
        translation_m: root mean square of the distance between true and wrong position.
        rng: decides the errors.
    """
    return camera_to_world @ _errors(_normal(rng, len(camera_to_world)), rotation_rad, translation_m)


def drift_poses(
    camera_to_world: Float[np.ndarray, "views 4 4"], rotation_rad: float, translation_m: float, rng: np.random.Generator
) -> Float[np.ndarray, "views 4 4"]:
    """Poses with errors that wander: those of neighbours are alike, and they grow with the root of time.

    Args:
        camera_to_world: true poses in the order they were taken; the first one stays as it is.
        rotation_rad: root mean square of the last pose's angle from the true orientation.
        translation_m: root mean square of the last pose's distance from the true position.
        rng: decides the errors.
    """
    steps = len(camera_to_world) - 1
    walk = np.cumsum(_normal(rng, steps), axis=0) / np.sqrt(max(steps, 1))
    return camera_to_world @ _errors(np.concatenate([np.zeros((1, 6)), walk]), rotation_rad, translation_m)


def _normal(rng: np.random.Generator, count: int) -> Float[np.ndarray, "n 6"]:
    """Rotation vectors and translations whose lengths have a root mean square of 1."""
    return rng.normal(size=(count, 6)) / np.sqrt(3)


def _errors(unit: Float[np.ndarray, "n 6"], rotation_rad: float, translation_m: float) -> Float[np.ndarray, "n 4 4"]:
    from scipy.spatial.transform import Rotation

    errors = np.tile(np.eye(4), (len(unit), 1, 1))
    errors[:, :3, :3] = Rotation.from_rotvec(rotation_rad * unit[:, :3]).as_matrix()
    errors[:, :3, 3] = translation_m * unit[:, 3:]
    return errors
