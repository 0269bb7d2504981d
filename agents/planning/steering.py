"""From where a policy wants to go and look to the action that does it."""

from typing import Any

import numpy as np
from jaxtyping import Float

from sbm_gym.env.gaze import PITCH_RAD, TILT_RAD, TURN_RAD, yaw_action
from sbm_gym.robot.angles import wrap


def bearing_rad(from_m: Float[np.ndarray, "2"], to_m: Float[np.ndarray, "2"]) -> float:
    """Direction from one place to another, counter-clockwise from +X."""
    return float(np.arctan2(to_m[1] - from_m[1], to_m[0] - from_m[0]))


def move_action(step_m: Float[np.ndarray, "2"], yaw_rad: float, stride_m: float) -> Float[np.ndarray, "2"]:
    """The move action (forward, left) for a world displacement of at most a stride, rounding kept inside [-1, 1]."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    forward_left = np.array([cos * step_m[0] + sin * step_m[1], -sin * step_m[0] + cos * step_m[1]])
    return np.clip(forward_left / stride_m, -1.0, 1.0)


def move_and_look(
    info: dict[str, Any],
    stride_m: float,
    step_m: Float[np.ndarray, "2"],
    yaw_rad: float,
    tilt_rad: float,
) -> Float[np.ndarray, "4"]:
    """The action that makes a step and then looks in a direction.

    Before any object is confirmed the camera turns by at most 60 degrees a step, and looks as nearly as possible in
    that direction. From then on it can point anywhere.

    Args:
        info: of the latest step.
        stride_m: the longest move of a step.
        step_m: where to go from here, world axes, at most a stride.
        yaw_rad: where to look, counter-clockwise from +X.
        tilt_rad: up is positive.
    """
    agent, target = info["agent"], info["fixation_target"]
    move = move_action(step_m, agent["yaw_rad"], stride_m)
    if not target:
        turn = wrap(yaw_rad - agent["yaw_rad"]) / TURN_RAD
        tilt = (tilt_rad - agent["tilt_rad"]) / TILT_RAD
    else:
        place_m, centroid_m = agent["position_m"] + step_m, target["centroid_m"]
        drop_m = centroid_m[2] - agent["camera_to_world"][2, 3]
        target_tilt_rad = np.arctan2(drop_m, max(float(np.linalg.norm(centroid_m[:2] - place_m)), 1e-6))
        turn = yaw_action(float(wrap(yaw_rad - bearing_rad(place_m, centroid_m[:2]))))
        tilt = (tilt_rad - target_tilt_rad) / PITCH_RAD
    return np.clip(np.array([*move, turn, tilt]), -1.0, 1.0)
