"""What a robot knows that was given no map: it goes by what its depth camera has shown and what it has run into."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from sbm_gym.env.simulation import displacement_of
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.robot.object_beliefs import ObjectBeliefs
from sbm_gym.robot.object_memory import KnownObject
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.worlds.geometry.navigable import AGENT_RADIUS_M, NavigableMap

AHEAD_STRIDES = 2.0
"""Floor is hoped for this far beyond what has been seen: what lies farther no look from here tells about."""
LOW_CELLS = 2
"""Layers of ``SeenSpace`` that no obstacle is looked for in: the one under the floor and the one that it lies in."""


class Unmapped(RobotKnowledge):
    """``RobotKnowledge`` of a robot without a map.

    It knows the rectangle that it is to stay in, and nothing of what is in it. Where it can stand is where nothing that
    it has seen is in the way of its body; what it has not seen counts as free, as in ``SeenSpace``, until it has run
    into something there. Unseen floor is what may be floor a little beyond what it has seen, on ways that nothing seen
    blocks (frontiers: Yamauchi 1997). All else is as in the knowledge that this is made of. Of that one's map nothing
    is used but its limits and the grid of seen floor, in which floor too close to furniture to stand on is never noted.
    """

    def __init__(self, robot: RobotKnowledge, info: dict[str, Any]) -> None:
        """Starts an episode.

        Args:
            robot: what it would know with a map.
            info: what ``env.reset`` returned.
        """
        self._robot = robot
        self.stride_m, self.camera_height_m = robot.stride_m, robot.camera_height_m
        self.rest_tilt_rad, self.max_depth_m = robot.rest_tilt_rad, robot.max_depth_m
        self.ring_m, self.ring_clearance_m = robot.ring_m, robot.ring_clearance_m
        self.search_distance_m, self.view_bins = robot.search_distance_m, robot.view_bins
        self.view_history, self.seen_space = robot.view_history, robot.seen_space
        filled, origin_m, self._cell_m = robot.seen_space.grid
        self._origin_m = origin_m[:2]
        self._run_into, self._stood_on = np.zeros(filled.shape[1::-1], bool), np.zeros(filled.shape[1::-1], bool)
        # The outermost cells of seen space lie outside of the rectangle.
        self._run_into[[0, -1]] = self._run_into[:, [0, -1]] = True
        self._goal_m: Float[np.ndarray, "2"] | None = None
        self.seen_floor = _HopedForFloor(robot.seen_floor)
        self.update(info)

    def update(self, info: dict[str, Any]) -> None:
        """Takes in the latest view, and what the latest move ran into.

        Args:
            info: of the latest step.
        """
        here_m = np.asarray(info["agent"]["position_m"], float)
        if self._goal_m is not None and info["collided"]:
            ahead_m = self._goal_m - here_m
            reach_m = AGENT_RADIUS_M + 0.5 * self._cell_m
            self._mark(self._run_into, here_m + ahead_m * (reach_m / max(float(np.linalg.norm(ahead_m)), 1e-9)))
        self._goal_m = None
        self._mark(self._stood_on, here_m)
        self.navigable = NavigableMap(self._free(), self._origin_m, self._cell_m)
        """Where the middle of its body may be, as far as it knows."""
        self.seen_floor.update(self.navigable, here_m)

    def note_action(self, action: Float[np.ndarray, "4"], info: dict[str, Any]) -> None:
        """Notes where an action will send the body, to know what it ran into if it does not get there.

        Args:
            action: of the environment.
            info: of the latest step before it.
        """
        agent = info["agent"]
        step_m = displacement_of(action[:2], agent["yaw_rad"], self.stride_m)
        self._goal_m = np.asarray(agent["position_m"], float) + step_m

    @property
    def views_left(self) -> int:
        """Steps until the episode ends."""
        return self._robot.views_left

    @property
    def objects(self) -> Sequence[KnownObject]:
        """The confirmed objects."""
        return self._robot.objects

    @property
    def target(self) -> KnownObject | None:
        """The object that it fixates."""
        return self._robot.target

    @property
    def beliefs(self) -> ObjectBeliefs:
        """What all looks say of everything that the detector has pointed at."""
        return self._robot.beliefs

    def fixate(self, object_id: int) -> None:
        """Makes another confirmed object the fixation target; see ``RobotKnowledge``."""
        self._robot.fixate(object_id)

    def _free(self) -> Bool[np.ndarray, "ny nx"]:
        """Where nothing known stands in the way of the body, and where it has stood."""
        import cv2

        filled, _, _ = self._robot.seen_space.grid
        top = LOW_CELLS + int(np.ceil(self.camera_height_m / self._cell_m))
        blocked = self._run_into | filled[:, :, LOW_CELLS:top].any(axis=2).T
        # What is seen lies anywhere in its cell.
        cells = int((AGENT_RADIUS_M + 0.5 * self._cell_m) / self._cell_m)
        body = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * cells + 1, 2 * cells + 1))
        return (cv2.dilate(blocked.view(np.uint8), body) == 0) | self._stood_on

    def _mark(self, cells: Bool[np.ndarray, "ny nx"], place_m: Float[np.ndarray, "2"]) -> None:
        column, row = np.floor((place_m - self._origin_m) / self._cell_m).astype(int)
        if 0 <= row < cells.shape[0] and 0 <= column < cells.shape[1]:
            cells[row, column] = True


class _HopedForFloor(SeenFloor):
    """Floor as far as it has been seen, and what may be floor a little beyond."""

    def __init__(self, seen: SeenFloor) -> None:
        """Starts with nothing.

        Args:
            seen: what has been seen; whoever owns it adds the views.
        """
        self._seen = seen
        self.cell_m, self.stride_m, self._origin_m = seen.cell_m, seen.stride_m, seen.origin_m
        self._all_centres_m = self.centre_m(np.argwhere(np.ones(seen.is_floor.shape, bool)))

    def update(self, navigable: NavigableMap, here_m: Float[np.ndarray, "2"]) -> None:
        """Takes in the latest view.

        Args:
            navigable: where the robot can stand, as far as it knows.
            here_m: where it stands.
        """
        import cv2

        self.num_views, self._seen_at = self._seen.num_views, self._seen.seen_at
        free = navigable.are_free(self._all_centres_m).reshape(self._seen_at.shape).view(np.uint8)
        hoped_for, neighbours = free * (self._seen_at >= 0), np.ones((3, 3), np.uint8)
        for _ in range(int(AHEAD_STRIDES * self.stride_m / self.cell_m)):
            hoped_for = cv2.dilate(hoped_for, neighbours) * free
        _, parts = cv2.connectedComponents(hoped_for, connectivity=4)
        row, column = self.cell(here_m)
        inside = 0 <= row < parts.shape[0] and 0 <= column < parts.shape[1]
        mine = parts[row, column] if inside else 0
        self.is_floor = parts == mine if mine else hoped_for > 0
        """What is floor, or may be, where the robot can get to as far as it knows."""
        self._cells = np.argwhere(self.is_floor)
        self._centres_m = self.centre_m(self._cells)
