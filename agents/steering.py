"""From where a policy wants to go and look to the action that does it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from sbm_gym.episode import OFFSET_RAD, TILT_RAD, TURN_RAD


def wrap(angle_rad):
    """Angles (a number or an array) in [-pi, pi)."""
    return (angle_rad + np.pi) % (2.0 * np.pi) - np.pi


def bearing_rad(from_m: Float[np.ndarray, "2"], to_m: Float[np.ndarray, "2"]) -> float:
    """Direction from one place to another, counter-clockwise from +X."""
    return float(np.arctan2(to_m[1] - from_m[1], to_m[0] - from_m[0]))


def move_action(step_m: Float[np.ndarray, "2"], yaw_rad: float, stride_m: float) -> Float[np.ndarray, "2"]:
    """The move action (forward, left) for a world displacement of at most a stride, rounding kept inside [-1, 1]."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    forward_left = np.array([cos * step_m[0] + sin * step_m[1], -sin * step_m[0] + cos * step_m[1]])
    return np.clip(forward_left / stride_m, -1.0, 1.0)


def nearest_allowed(
    wanted_rad: float, place_m: Float[np.ndarray, "2"], objects: Sequence[dict[str, Any]]
) -> tuple[int, float]:
    """Which object to fixate so that the camera can point nearest to a direction.

    Args:
        wanted_rad: the direction.
        place_m: where the camera will be.
        objects: the confirmed ones, at least one, as ``info["confirmed_objects"]`` lists them.

    Returns:
        The object's id, and the yaw offset from it, radians, at most what the action space allows either way.
    """
    offsets = [wrap(wanted_rad - bearing_rad(place_m, known["centroid_m"][:2])) for known in objects]
    best = int(np.argmin(np.abs(offsets)))
    return objects[best]["object_id"], float(np.clip(offsets[best], -OFFSET_RAD, OFFSET_RAD))


def look(
    env: Any, info: dict[str, Any], step_m: Float[np.ndarray, "2"], yaw_rad: float, tilt_rad: float
) -> Float[np.ndarray, "4"]:
    """The action that makes a step and then looks as nearly as possible in a direction.

    Before any object is confirmed the camera turns by at most 60 degrees a step. From then on it points at most 45
    degrees past a confirmed object: that which allows the direction best becomes the fixation target.

    Args:
        env: the unwrapped environment.
        info: of the latest step.
        step_m: where to go from here, world axes, at most a stride.
        yaw_rad: where to look, counter-clockwise from +X.
        tilt_rad: up is positive.
    """
    agent = info["agent"]
    move = move_action(step_m, agent["yaw_rad"], env.stride_m)
    objects = info["confirmed_objects"]
    if not objects:
        turn = wrap(yaw_rad - agent["yaw_rad"]) / TURN_RAD
        tilt = (tilt_rad - agent["tilt_rad"]) / TILT_RAD
    else:
        place_m = agent["position_m"] + step_m
        object_id, offset_rad = nearest_allowed(yaw_rad, place_m, objects)
        env.fixate(object_id)
        centroid_m = next(known["centroid_m"] for known in objects if known["object_id"] == object_id)
        drop_m = centroid_m[2] - agent["camera_to_world"][2, 3]
        target_tilt_rad = np.arctan2(drop_m, max(float(np.linalg.norm(centroid_m[:2] - place_m)), 1e-6))
        turn, tilt = offset_rad / OFFSET_RAD, (tilt_rad - target_tilt_rad) / OFFSET_RAD
    return np.clip(np.array([*move, turn, tilt]), -1.0, 1.0)
