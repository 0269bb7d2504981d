"""The ``frontier`` policy: explores. It goes where the floor it has seen ends and looks where it goes.

Of all frontiers it heads for the one with most unseen floor around it for the steps it takes. It does so before and
after objects are found: what it sees of objects, it sees on its way. When no frontier is left it forgets what it has
seen and goes round again.

Source: Yamauchi 1997, "A frontier-based approach for autonomous exploration".
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from agents.planning.frontiers import Frontiers
from agents.planning.paths import advance
from agents.planning.steering import bearing_rad, move_and_look
from agents.policies.base import RobotPolicy
from sbm_gym.env.gaze import TURN_RAD

STUCK_STRIDES = 0.1
ARRIVED_STRIDES = 0.75
PATIENCE_STEPS = 12
"""A frontier that has not been seen after so many steps is given up."""


class FrontierPolicy(RobotPolicy):
    """Goes to where the seen floor ends."""

    def start(self, info: dict[str, Any]) -> None:
        """Starts an episode."""
        self._frontiers = Frontiers(self.robot.seen_floor)
        self._goal_m: Float[np.ndarray, "2"] | None = None
        self._steps_on_goal = 0
        self._previous_m: Float[np.ndarray, "2"] | None = None

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A stride towards the frontier, and a look there."""
        agent = info["agent"]
        position_m = agent["position_m"]
        self._drop_goal_if_done(position_m)
        if self._goal_m is None:
            self._goal_m = self._frontiers.next_goal(self.robot.navigable, position_m, agent["yaw_rad"], self.rng)
            self._steps_on_goal = 0
        step_m = advance(self.robot.navigable, position_m, self._goal_m, self.robot.stride_m)
        if step_m is None:
            self._frontiers.give_up(self._goal_m)
            self._goal_m, step_m = None, np.zeros(2)
        self._previous_m = position_m.copy()
        self._steps_on_goal += 1
        yaw_rad = self._gaze_rad(position_m, step_m, agent["yaw_rad"])
        action = move_and_look(info, self.robot.stride_m, step_m, yaw_rad, self.robot.rest_tilt_rad)
        return action.astype(np.float32)

    def _drop_goal_if_done(self, position_m: Float[np.ndarray, "2"]) -> None:
        """Drops the goal once it has been seen, and gives it up where it cannot be seen."""
        if self._goal_m is None:
            return
        stride_m = self.robot.stride_m
        if not self._frontiers.is_open(self._goal_m):
            self._goal_m = None
            return
        arrived = np.linalg.norm(position_m - self._goal_m) < ARRIVED_STRIDES * stride_m
        moved_m = stride_m if self._previous_m is None else float(np.linalg.norm(position_m - self._previous_m))
        if arrived or moved_m < STUCK_STRIDES * stride_m or self._steps_on_goal >= PATIENCE_STEPS:
            self._frontiers.give_up(self._goal_m)
            self._goal_m = None

    def _gaze_rad(self, position_m: Float[np.ndarray, "2"], step_m: Float[np.ndarray, "2"], yaw_rad: float) -> float:
        """Towards the goal where nothing on the map is between, else along the step."""
        after_m = position_m + step_m
        if self._goal_m is None:
            return yaw_rad + TURN_RAD
        navigable = self.robot.navigable
        if np.linalg.norm(self._goal_m - after_m) > 1e-6 and navigable.line_is_free(after_m, self._goal_m):
            return bearing_rad(after_m, self._goal_m)
        return bearing_rad(position_m, after_m) if np.any(step_m) else yaw_rad + TURN_RAD
