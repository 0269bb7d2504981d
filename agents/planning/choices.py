"""Actions chosen from a few: one of eight moves or none, and what to look at. No planner, no goal, no search.

A move goes a stride to one of eight sides, counted from where the camera points. Where the map shows something in the
way it is turned aside by as little as possible, so that no choice runs into furniture. What to look at are the things
that the ``state`` observation tells about, in its order, or directions; the camera points there after the move, at
things also up or down.
"""

from typing import Any

import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from agents.planning.steering import bearing_rad, move_and_look
from agents.planning.unmapped import Unmapped
from sbm_gym.env.state_vector import CANDIDATES, likely_candidates, nearest_others
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.worlds.geometry.navigable import NavigableMap

DIRECTIONS = 8
STAY = DIRECTIONS
"""The move that is none; those before it are directions, counter-clockwise from where the camera points."""
OTHERS_TO_LOOK_AT = 2
"""So many confirmed objects beside the fixation target can be looked at, the nearest first."""
HEADINGS = 12
TURNS_RAD = tuple(2.0 * np.pi / HEADINGS * k for k in range(1, HEADINGS))
"""Turns from where the camera points, counter-clockwise."""
LOOKS = (
    "target",
    *(f"candidate_{k}" for k in range(CANDIDATES)),
    *(f"other_{k}" for k in range(OTHERS_TO_LOOK_AT)),
    *TURNS_RAD,
)
"""What can be looked at: things by name, and turns from where the camera points. What is not there is the target, and
without a target straight ahead."""
ACTION_SPACE = spaces.MultiDiscrete([DIRECTIONS + 1, len(LOOKS)])
ASIDE_RAD = np.deg2rad([0.0, 15.0, -15.0, 30.0, -30.0, 45.0, -45.0, 60.0, -60.0, 75.0, -75.0, 90.0, -90.0])
"""By how much a blocked move is turned aside, tried in this order."""


def chosen_action(choice: Any, info: dict[str, Any], robot: RobotKnowledge) -> Float[np.ndarray, "4"]:
    """The environment's action for a choice.

    Args:
        choice: number of the move and of the look.
        info: of the latest step.
        robot: what it knows.
    """
    move, look = (int(number) for number in choice)
    agent = info["agent"]
    position_m, heading_rad = agent["position_m"], agent["yaw_rad"]
    step_m = np.zeros(2)
    if move != STAY:
        step_m = free_step(robot.navigable, position_m, robot.stride_m, heading_rad + move * 2.0 * np.pi / DIRECTIONS)
    where_rad = _looked_at_rad(LOOKS[look], info, robot, position_m + step_m)
    action = move_and_look(info, robot.stride_m, step_m, *where_rad)
    if isinstance(robot, Unmapped):
        robot.note_action(action, info)
    return action


def free_step(
    navigable: NavigableMap, position_m: Float[np.ndarray, "2"], length_m: float, direction_rad: float
) -> Float[np.ndarray, "2"]:
    """A step to one side, or, as far as that is blocked, nearly to that side.

    Args:
        navigable: where one can stand.
        position_m: where the step begins.
        length_m: of the step.
        direction_rad: counter-clockwise from +X.

    Returns:
        The displacement: turned aside by at most a quarter turn, or of half the length; zero where nothing is free.
    """
    for length in (length_m, 0.5 * length_m):
        for aside_rad in ASIDE_RAD:
            angle = direction_rad + aside_rad
            step_m = length * np.array([np.cos(angle), np.sin(angle)])
            if navigable.line_is_free(position_m, position_m + step_m):
                return step_m
    return np.zeros(2)


def _looked_at_rad(
    what: str | float, info: dict[str, Any], robot: RobotKnowledge, from_m: Float[np.ndarray, "2"]
) -> tuple[float, float]:
    """Where the camera points to look at something: counter-clockwise from +X, and up."""
    agent, target = info["agent"], robot.target
    if not isinstance(what, str):
        return agent["yaw_rad"] + what, robot.rest_tilt_rad
    kind, _, number = what.partition("_")
    camera_m = agent["camera_to_world"][:3, 3]
    found = [] if target is None else [target.centroid_m]
    if kind == "candidate":
        found = [one.centroid_m for one in likely_candidates(robot)[int(number) :]] + found
    elif kind == "other":
        found = [one.centroid_m for one in nearest_others(robot, camera_m)[int(number) :]] + found
    if not found:
        return agent["yaw_rad"], robot.rest_tilt_rad
    distance_m = max(float(np.linalg.norm(found[0][:2] - from_m)), 1e-6)
    return bearing_rad(from_m, found[0][:2]), float(np.arctan2(found[0][2] - camera_m[2], distance_m))
