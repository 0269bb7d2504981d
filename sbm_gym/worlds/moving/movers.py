"""Things that move along routes, and wait for whatever is in their way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from labeling.core.types import Box3d
from sbm_gym.worlds.geometry.placing import Box, overlap, rotation
from sbm_gym.worlds.moving.route import Route

MARGIN_M = 0.08
"""Nothing that moves comes nearer than this to anything else that may move."""
STEP_M = 0.1
"""Whether the way is free is looked at as often as this."""


@dataclass(frozen=True)
class Crossing:
    """A stretch of a mover's way in which it has a junction to itself."""

    start_m: float
    end_m: float
    junction: int


@dataclass(frozen=True)
class Mover:
    """Something that moves in an episode.

    A vehicle has its axles on the route, looks where it goes, and waits where its way is blocked or ends. What is
    carried has its middle there, turns evenly, and goes back where its way is blocked or ends.
    """

    instance_id: int
    body_name: str
    size_m: tuple[float, float, float]
    """Width, depth and height of the box around it; at yaw 0 its front looks towards -Y."""
    route: Route
    speed_m_s: float
    wheelbase_m: float = 0.0
    """Between the axles, 0 for what is carried."""
    yaw_rad: float = 0.0
    """Of what is carried, at the start."""
    turn_rad_m: float = 0.0
    """By how much what is carried turns on each metre."""
    ahead_m: float = 0.1
    """How far ahead the way must be free."""
    crossings: tuple[Crossing, ...] = ()

    @property
    def end_m(self) -> float:
        """How far it comes at most."""
        return max(0.0, self.route.length_m - self.wheelbase_m)

    def pose(self, along_m: float) -> tuple[float, float, float]:
        """Where it stands (x and y of its middle, metres) and its yaw (rad), so far along its way."""
        rear = self.route.at(along_m)
        if self.wheelbase_m <= 0.0:
            return float(rear[0]), float(rear[1]), self.yaw_rad + self.turn_rad_m * along_m
        axle = self.route.at(along_m + self.wheelbase_m) - rear
        middle = rear + 0.5 * axle
        return float(middle[0]), float(middle[1]), float(np.arctan2(axle[1], axle[0])) + 0.5 * np.pi

    def start_pose(self) -> Float[np.ndarray, "4 4"]:
        """Object to world where it sets out."""
        return _matrix(self.pose(0.0))

    def box(self, along_m: float) -> Box:
        """The floor it covers, so far along its way."""
        x, y, yaw = self.pose(along_m)
        return Box(x, y, self.size_m[0] / 2, self.size_m[1] / 2, yaw)


class Traffic:
    """What moves in one episode: where it is, and how it goes on."""

    def __init__(self, movers: Sequence[Mover], robot_radius_m: float) -> None:
        """All stand at the beginning of their ways.

        Args:
            movers: they do not touch each other there.
            robot_radius_m: of the robot, for which they wait.
        """
        self.movers = tuple(movers)
        self._along_m = np.zeros(len(self.movers))
        self._way = np.ones(len(self.movers), int)
        self._radius_m = robot_radius_m

    def advance(self, seconds: float, robot_m: Float[np.ndarray, "2"]) -> None:
        """Moves everything on, one after the other, each as far as its way is free.

        Args:
            seconds: that pass.
            robot_m: where the robot stands meanwhile.
        """
        robot = Box(float(robot_m[0]), float(robot_m[1]), self._radius_m, self._radius_m, 0.0)
        boxes = self.boxes()
        for k, mover in enumerate(self.movers):
            others = [robot, *(box for other, box in enumerate(boxes) if other != k)]
            left_m = mover.speed_m_s * seconds
            while left_m > 1e-9:
                step_m = min(STEP_M, left_m)
                next_m = min(max(float(self._along_m[k] + self._way[k] * step_m), 0.0), mover.end_m)
                arrived = next_m == self._along_m[k]
                if arrived or self._is_taken(k, next_m) or self._is_blocked(mover, next_m, int(self._way[k]), others):
                    if mover.wheelbase_m <= 0.0:
                        self._way[k] = -self._way[k]
                    break
                self._along_m[k], left_m = next_m, left_m - step_m
            boxes[k] = mover.box(float(self._along_m[k]))

    def boxes(self) -> list[Box]:
        """The floor that each thing covers now."""
        return [mover.box(float(along_m)) for mover, along_m in zip(self.movers, self._along_m, strict=True)]

    def poses(self) -> dict[int, Float[np.ndarray, "4 4"]]:
        """Object to world of each thing now, by instance id; an object's origin is in the middle of its floor."""
        return {
            mover.instance_id: _matrix(mover.pose(float(along_m)))
            for mover, along_m in zip(self.movers, self._along_m, strict=True)
        }

    def floor_poses(self) -> list[tuple[float, float, float]]:
        """Where each thing stands now (x and y, metres), and its yaw (rad)."""
        return [mover.pose(float(along_m)) for mover, along_m in zip(self.movers, self._along_m, strict=True)]

    def is_near(self, from_m: Float[np.ndarray, "2"], to_m: Float[np.ndarray, "2"]) -> bool:
        """Whether anything may be in the robot's way between two places."""
        start, way = np.asarray(from_m, float), np.asarray(to_m, float) - from_m
        squared = max(float(way @ way), 1e-12)
        for box in self.boxes():
            offset = np.array([box.x_m, box.y_m]) - start
            nearest = start + way * min(max(float(offset @ way) / squared, 0.0), 1.0)
            apart_m = float(np.hypot(box.x_m - nearest[0], box.y_m - nearest[1]))
            if apart_m <= float(np.hypot(box.half_x_m, box.half_y_m)) + self._radius_m + MARGIN_M:
                return True
        return False

    def _is_taken(self, k: int, next_m: float) -> bool:
        """Whether the next step leads into a junction that another one is in."""
        for own in self.movers[k].crossings:
            if not self._along_m[k] < own.start_m <= next_m:
                continue
            for other, mover in enumerate(self.movers):
                inside = (one for one in mover.crossings if one.junction == own.junction)
                if other != k and any(one.start_m <= self._along_m[other] <= one.end_m for one in inside):
                    return True
        return False

    @staticmethod
    def _is_blocked(mover: Mover, next_m: float, way: int, others: Sequence[Box]) -> bool:
        for ahead_m in (0.0, 0.5 * mover.ahead_m, mover.ahead_m):
            box = mover.box(min(max(next_m + way * ahead_m, 0.0), mover.end_m))
            if any(overlap(box, other, MARGIN_M) for other in others):
                return True
        return False


def _matrix(pose: tuple[float, float, float]) -> Float[np.ndarray, "4 4"]:
    x, y, yaw = pose
    found = np.eye(4)
    found[:2, :2], found[:2, 3] = rotation(yaw), (x, y)
    return found


def moved_box(box: Box3d, pose: Float[np.ndarray, "4 4"]) -> Box3d:
    """The 3-D box of an object that stands somewhere else now.

    Args:
        box: of the object; its height above the floor stays.
        pose: object to world; only a turn about the upright axis, and a place on the floor.
    """
    centre = np.array([pose[0, 3], pose[1, 3], box.centre_m[2]])
    return Box3d(centre, box.extent_m, pose[:3, :3].copy())
