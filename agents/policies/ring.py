"""The ``ring`` policy: the thesis' hand-written one, both stages.

Stage one: turn on the spot by 60 degrees until a view has a confident detection; after a full turn without one go to
another random place and turn again. All confident masks of that view become objects (centroid from depth, centroid
non-maximum suppression: the env's object memory does both).

Stage two: places on a ring around the object (1-2 m in rooms, 3-15 m in streets: the world's profile) where the robot
can stand and from where nothing known hides the object, in 18 sectors; go from sector to sector around the object, at
most a stride per view, the centroid in the middle of the picture. When no reachable sector is left, go on to the next
object.

Source: thesis 4.2 and A.2.2.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from agents.planning.paths import advance, path_length_m
from agents.planning.steering import bearing_rad, move_action
from agents.policies.base import RobotPolicy
from sbm_gym.env.gaze import TURN_RAD
from sbm_gym.robot.angles import wrap
from sbm_gym.robot.line_of_sight import stop_short

TURNS_PER_PLACE = 5
"""Five turns of 60 degrees show six views: all around."""
RING_SAMPLES = 900
STUCK_M = 0.05
REVERSAL_STRIDES = 2.0
"""Going back is worth it only if the next sector is this many strides nearer on the other side."""


class Ring(RobotPolicy):
    """Spins until it finds an object, then circles it."""

    def start(self, info: dict[str, Any]) -> None:
        """Starts an episode."""
        self._map = self.robot.navigable
        self._turns_left = TURNS_PER_PLACE
        self._search_goal: Float[np.ndarray, "2"] | None = None
        self._circled: int | None = None
        self._direction = 0
        self._given_up: dict[int, set[int]] = {}
        self._goal: tuple[int, Float[np.ndarray, "2"]] | None = None
        self._previous_m = info["agent"]["position_m"]

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """Turns, walks or circles; see the module."""
        agent = info["agent"]
        action = self._circle(info) if info["fixation_target"] else self._search(info)
        self._previous_m = agent["position_m"]
        return action.astype(np.float32)

    # Stage one: search ------------------------------------------------------------------------------------------------

    def _search(self, info: dict[str, Any]) -> np.ndarray:
        agent = info["agent"]
        if self._search_goal is None and self._turns_left > 0:
            self._turns_left -= 1
            return np.array([0.0, 0.0, 1.0, 0.0])
        if self._search_goal is None:
            self._search_goal = self._another_place(agent["position_m"])
        step_m = advance(self._map, agent["position_m"], self._search_goal, self.robot.stride_m)
        arrived = step_m is None or np.linalg.norm(agent["position_m"] + step_m - self._search_goal) < STUCK_M
        if arrived or info["collided"]:
            self._search_goal, self._turns_left = None, TURNS_PER_PLACE
        if step_m is None:
            return np.array([0.0, 0.0, 1.0, 0.0])
        turn_rad = wrap(float(np.arctan2(step_m[1], step_m[0])) - agent["yaw_rad"])
        return np.array([*self._move(step_m, agent), np.clip(turn_rad / TURN_RAD, -1.0, 1.0), 0.0])

    def _another_place(self, position_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """A random navigable point, neither too near nor too far."""
        place = self._map.random_point(self.rng)
        for _ in range(20):
            nearest_m, farthest_m = self.robot.search_distance_m
            if nearest_m <= np.linalg.norm(place - position_m) <= farthest_m:
                break
            place = self._map.random_point(self.rng)
        return place

    # Stage two: circle ------------------------------------------------------------------------------------------------

    def _circle(self, info: dict[str, Any]) -> np.ndarray:
        target, agent = info["fixation_target"], info["agent"]
        position_m = agent["position_m"]
        if target["object_id"] != self._circled:
            self._circled, self._direction, self._goal = target["object_id"], 0, None
        self._drop_goal_if_done(target, position_m)
        if self._goal is None:
            self._goal = self._next_goal(target, position_m)
        if self._goal is None:
            target = self._next_object(info) or target
            self._goal = self._next_goal(target, position_m) or (-1, self._any_ring_point(target))
        step_m = advance(self._map, position_m, self._goal[1], self.robot.stride_m)
        if step_m is None:
            self._give_up(target["object_id"], self._goal[0])
            return np.zeros(4)
        return np.array([*self._move(step_m, agent), 0.0, 0.0])

    def _drop_goal_if_done(self, target: dict[str, Any], position_m: Float[np.ndarray, "2"]) -> None:
        """Drops the goal once reached or hopeless; a sector that was reached without being seen is given up."""
        if self._goal is None:
            return
        sector, place_m = self._goal
        if sector in target["azimuths"]:
            self._goal = None
        elif np.linalg.norm(position_m - place_m) < STUCK_M or np.linalg.norm(position_m - self._previous_m) < STUCK_M:
            self._give_up(target["object_id"], sector)

    def _give_up(self, object_id: int, sector: int) -> None:
        self._given_up.setdefault(object_id, set()).add(sector)
        self._goal = None

    def _next_goal(
        self, target: dict[str, Any], position_m: Float[np.ndarray, "2"]
    ) -> tuple[int, Float[np.ndarray, "2"]] | None:
        """A place in the next sector around the object that is left, None if none is."""
        places, sectors = self._ring(target)
        done = set(target["azimuths"]) | self._given_up.get(target["object_id"], set())
        left = sorted(set(sectors.tolist()) - done)
        if not left:
            return None
        if np.linalg.norm(position_m - target["centroid_m"][:2]) > self.robot.ring_m[1] + self.robot.stride_m:
            # From afar: the place at the end of the shortest path, of the nearest one of each sector that is left.
            nearest = [(sector, self._place_in(places[sectors == sector], position_m)) for sector in left]
            return min(nearest, key=lambda goal: (path_length_m(self._map, position_m, goal[1]), goal[0]))
        count = self.robot.view_bins.num_azimuths
        here = int(self.robot.view_bins.azimuth_bin(bearing_rad(target["centroid_m"][:2], position_m)))
        goals = {}
        for turn in (1, -1):
            sector = (here + turn * min((turn * (sector - here)) % count for sector in left)) % count
            goals[turn] = sector, self._place_in(places[sectors == sector], position_m)
        if self._direction == 0:
            self._direction = _first_direction(left, here, count, self.robot.views_left)
        elif goals[1][0] != goals[-1][0]:
            lengths_m = {turn: path_length_m(self._map, position_m, place_m) for turn, (_, place_m) in goals.items()}
            if lengths_m[self._direction] > lengths_m[-self._direction] + REVERSAL_STRIDES * self.robot.stride_m:
                self._direction = -self._direction
        return goals[self._direction]

    def _place_in(self, places: Float[np.ndarray, "n 2"], position_m: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        """A random one of the places that one stride reaches, else the nearest."""
        distances_m = np.linalg.norm(places - position_m, axis=1)
        start_m = self._map.nearest_free(position_m)
        near = [place for place in places[distances_m <= self.robot.stride_m] if self._map.line_is_free(start_m, place)]
        return near[int(self.rng.integers(len(near)))] if near else places[int(np.argmin(distances_m))]

    def _ring(self, target: dict[str, Any]):
        """Navigable, non-obstructed places around an object, and the sector of each."""
        rng = np.random.default_rng([target["object_id"], 1])
        angle = rng.uniform(0.0, 2.0 * np.pi, RING_SAMPLES)
        low_m, high_m = self.robot.ring_m
        if self.robot.ring_clearance_m > 0.0:
            outside_m = 0.5 * float(np.max(target["extent_m"][:2])) + self.robot.ring_clearance_m
            low_m = min(max(low_m, outside_m), 0.5 * (low_m + high_m))
        radius_m = rng.uniform(low_m, high_m, RING_SAMPLES)
        centroid_m = target["centroid_m"]
        places = centroid_m[:2] + radius_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        places = places[self._map.are_free(places)]
        eyes = np.concatenate([places, np.full((len(places), 1), self.robot.camera_height_m)], axis=1)
        stop_short_m = stop_short(float(np.max(target["extent_m"])))
        places = places[self.robot.seen_space.sees(eyes, centroid_m, stop_short_m)]
        offsets = places - centroid_m[:2]
        return places, self.robot.view_bins.azimuth_bin(np.arctan2(offsets[:, 1], offsets[:, 0]))

    def _next_object(self, info: dict[str, Any]) -> dict[str, Any] | None:
        """Fixates the confirmed object with most to gain, if another one has a reachable sector left."""
        position_m = info["agent"]["position_m"]
        others = [known for known in info["confirmed_objects"] if known["object_id"] != self._circled]
        others.sort(key=lambda known: float(np.linalg.norm(known["centroid_m"][:2] - position_m)))
        for known in others:
            self._direction = 0
            if self._next_goal(known, position_m) is not None:
                self.robot.fixate(known["object_id"])
                self._circled, self._direction = known["object_id"], 0
                return known
        return None

    def _any_ring_point(self, target: dict[str, Any]) -> Float[np.ndarray, "2"]:
        """Somewhere else on the ring, for views at other ranges once every sector has been seen."""
        places, _ = self._ring(target)
        if len(places) == 0:
            return self._map.random_point(self.rng)
        return places[int(self.rng.integers(len(places)))]

    def _move(self, step_m: Float[np.ndarray, "2"], agent: dict[str, Any]) -> Float[np.ndarray, "2"]:
        return move_action(step_m, agent["yaw_rad"], self.robot.stride_m)


def _first_direction(left: list[int], here: int, count: int, steps_left: int) -> int:
    """Which way round sees more sectors in the steps left, at about one sector a step.

    The sectors that are left usually form an arc (walls block the rest). Going to its near end first costs the way
    there twice; going to the far end first may leave no steps for the near one.
    """
    up = sorted((sector - here) % count for sector in left)
    gaps = [after - before for before, after in zip([0, *up], [*up, count], strict=True)]
    widest = int(np.argmax(gaps))
    forth, back = up[:widest], [count - offset for offset in up[widest:]]
    if not forth or not back:
        return 1 if forth else -1
    reach = {1: max(forth), -1: max(back)}

    def seen(first: int) -> int:
        near, far = (forth, back) if first == 1 else (back, forth)
        spare = steps_left - 2 * reach[first]
        return sum(offset <= steps_left for offset in near) + sum(offset <= spare for offset in far)

    return 1 if (seen(1), -reach[1]) >= (seen(-1), -reach[-1]) else -1
