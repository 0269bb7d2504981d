"""Frontiers: where the floor that a robot has seen ends. Source: Yamauchi 1997, "A frontier-based approach for
autonomous exploration".
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from agents.planning.paths import path_length_m
from agents.planning.steering import bearing_rad
from sbm_gym.env.gaze import TURN_RAD
from sbm_gym.robot.angles import wrap
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.worlds.geometry.navigable import NavigableMap

MIN_STRIDES2 = 0.5
"""Smaller unseen patches, in squares of a stride, are not worth a step."""
MAX_FAILED_LOOKS = 2
NEIGHBOURHOOD_STRIDES = 4.0
"""The unseen floor so near to a frontier counts as its gain; farther in, walls will hide it."""
NUM_COMPARED = 6
"""So many frontiers, the best by straight-line distance, are compared by path length."""


@dataclass(frozen=True)
class Frontier:
    """A place on the floor where what has been seen ends."""

    place_m: Float[np.ndarray, "2"]
    """An unseen place beside seen ones, where the robot could stand."""
    unseen_m2: float
    """Unseen floor around it."""


class Frontiers:
    """The frontiers of the floor that a robot has seen, without those that it looked at and could not see."""

    def __init__(self, floor: SeenFloor) -> None:
        """Starts with none given up.

        Args:
            floor: what the robot has seen; whoever owns it adds the views.
        """
        self._floor = floor
        self._since = 0
        self._given_up = np.zeros_like(floor.unseen())
        self._failed_looks = np.zeros(self._given_up.shape, np.int32)

    def give_up(self, place_m: Float[np.ndarray, "2"]) -> None:
        """Leaves out unseen floor near a place: it has been looked at and could not be seen."""
        rows, columns = self._floor.cells_near(place_m, self._floor.stride_m).T
        self._given_up[rows, columns] = True

    def note_failed_look(self, place_m: Float[np.ndarray, "2"]) -> None:
        """Notes that a frontier ought to have been seen and was not; after ``MAX_FAILED_LOOKS`` it is given up."""
        cell = self._floor.cell(place_m)
        self._failed_looks[cell] += 1
        if self._failed_looks[cell] >= MAX_FAILED_LOOKS:
            self.give_up(place_m)

    def start_over(self) -> None:
        """Counts only what is seen from now on: for going round again."""
        self._since = self._floor.num_views + 1
        self._given_up[:], self._failed_looks[:] = False, 0

    def is_open(self, place_m: Float[np.ndarray, "2"]) -> bool:
        """Whether a frontier's place is still unseen and not given up."""
        cell = self._floor.cell(place_m)
        return bool(self._floor.unseen(self._since)[cell] and not self._given_up[cell])

    def remaining(self) -> list[Frontier]:
        """The patches of unseen floor that touch seen floor, each by the place nearest to the middle of its rim."""
        from scipy.ndimage import binary_dilation, label

        stride_m, cell_m = self._floor.stride_m, self._floor.cell_m
        unseen = self._floor.unseen(self._since) & ~self._given_up
        seen = self._floor.is_floor & ~unseen
        rim = unseen & np.asarray(binary_dilation(seen, np.ones((3, 3), bool)), bool)
        patches, count = label(rim, np.ones((3, 3), int))  # type: ignore[misc]
        found = []
        unseen_m = self._floor.centre_m(np.argwhere(unseen))
        for patch in range(1, count + 1):
            cells = np.argwhere(patches == patch)
            middle = cells[int(np.argmin(np.sum((cells - cells.mean(axis=0)) ** 2, axis=1)))]
            place_m = self._floor.centre_m(middle[None])[0]
            near = np.linalg.norm(unseen_m - place_m, axis=1) < NEIGHBOURHOOD_STRIDES * stride_m
            unseen_m2 = float(np.count_nonzero(near) * cell_m**2)
            if unseen_m2 >= MIN_STRIDES2 * stride_m**2:
                found.append(Frontier(place_m, unseen_m2))
        return found

    def next_goal(
        self, navigable: NavigableMap, position_m: Float[np.ndarray, "2"], yaw_rad: float, rng: np.random.Generator
    ) -> Float[np.ndarray, "2"]:
        """Where to stand to see most unseen floor for the steps it takes; without a frontier any place, to start over.

        Args:
            navigable: the map.
            position_m: where the robot is.
            yaw_rad: where its camera points.
            rng: draws the place where there is no frontier.
        """
        stride_m, frontiers = self._floor.stride_m, self.remaining()
        if not frontiers:
            self.start_over()
            return navigable.random_point(rng)

        def utility(frontier: Frontier, length_m: float) -> float:
            turns = abs(wrap(bearing_rad(position_m, frontier.place_m) - yaw_rad)) / TURN_RAD
            return frontier.unseen_m2 / (1.0 + max(length_m / stride_m, turns))

        frontiers.sort(key=lambda one: -utility(one, float(np.linalg.norm(one.place_m - position_m))))
        places_m = [navigable.nearest_free(one.place_m) for one in frontiers[:NUM_COMPARED]]
        utilities = [
            utility(one, path_length_m(navigable, position_m, place_m))
            for one, place_m in zip(frontiers, places_m, strict=False)
        ]
        return places_m[int(np.argmax(utilities))]
