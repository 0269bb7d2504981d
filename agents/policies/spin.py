"""The ``spin`` policy: turns on the spot by 60 degrees a step, all the way round."""

from typing import Any

import numpy as np

from agents.planning.steering import move_and_look
from agents.policies.base import RobotPolicy
from sbm_gym.env.gaze import TURN_RAD


class Spin(RobotPolicy):
    """Never moves from its place."""

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """A sixth of a turn on."""
        yaw_rad = info["agent"]["yaw_rad"] + TURN_RAD
        action = move_and_look(info, self.robot.stride_m, np.zeros(2), yaw_rad, self.robot.rest_tilt_rad)
        return action.astype(np.float32)
