"""Plans the next view: the one within reach with the highest utility, expected gain discounted by path length.

Views are places within a few strides, each with directions to look in. The expected gain of a view is the sum of
- for each confirmed object in it that nothing known hides: 1 for a sector not seen yet, a fraction for a new range or
  elevation;
- for each unconfirmed candidate in it: more, the surer the detector is already, less for each look that did not confirm
  it;
- for each frontier of the seen floor in it: by how much unseen floor lies there.

The gain is discounted for every step to the view, and nothing if the episode ends before. On the way the camera looks
where the gain is highest. Where no view within reach has any, it goes to the best frontier farther away. ``Priorities``
weigh the parts of the gain.

Source: Connolly 1985, "The determination of next best views"; gain times exp(-lambda length): Gonzalez-Banos and
Latombe 2002, "Navigation strategies for exploring indoor environments".
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int

from agents.planning.frontiers import Frontier, Frontiers
from agents.planning.kernels import expected_gains
from agents.planning.paths import advance, reachable_places
from agents.planning.steering import bearing_rad, move_and_look
from sbm_gym.env.gaze import TURN_RAD
from sbm_gym.env.state_vector import confirmation_score
from sbm_gym.robot.angles import wrap
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.robot.line_of_sight import stop_short
from sbm_gym.robot.object_memory import Cell
from sbm_gym.robot.seen_space import CLEAR_M
from sbm_gym.robot.view_history import IN_VIEW_RAD

BANDS_STRIDES = (1.0, 2.0, 4.0, 8.0)
"""Places are drawn band by band, so that there are near ones to choose from; beyond the last one nothing is reached."""
PLACES_PER_BAND = 30
PATH_COST = 0.2
"""Discount rate: the gain of a view is multiplied by exp(-PATH_COST) for every step to it."""
NEW_CELL = 0.2
"""A new range or elevation within a known sector, as a share of a new sector (as the env's reward has it)."""
CANDIDATE = 1.4
"""Looking at a candidate, in sectors, times the confidence it has already. Confirming it would be worth four (as the
env's reward has it), but most looks do not confirm it: of 4 and 1.4, the latter earned more in training scenes."""
FRONTIER_PER_STRIDE2 = 0.04
"""Unseen floor, squares of a stride: 25 of them are worth a sector."""
FLOOR_EYE_M = 0.1
"""Lines of sight to the floor end so far above it: the floor itself is filled."""
HEADINGS_RAD = -np.pi + np.arange(24) * (2.0 * np.pi / 24)
"""Directions considered at each place."""


@dataclass(frozen=True)
class Priorities:
    """Factors of the parts of the gain."""

    candidates: float = 1.0
    """Views of unconfirmed candidates."""
    floor: float = 1.0
    """Views of unseen floor."""
    sides: float = 1.0
    """Views of confirmed objects."""


DEFAULT_PRIORITIES = Priorities()


@dataclass(frozen=True)
class _Target:
    """An object, a candidate or a frontier to look at."""

    centre_m: Float[np.ndarray, "3"]
    stop_short_m: float
    """What stands so near to it belongs to it."""
    value_of_bins: Float[np.ndarray, "sectors ranges elevations"]
    """Gain of a view of it from each bin."""
    binned: bool = True
    """Whether only views within the bins' ranges count; else all do, up to the robot's reach."""


class ViewPlanner:
    """Plans one episode, view by view, from what the robot remembers."""

    def __init__(self, robot: RobotKnowledge, rng: np.random.Generator) -> None:
        """Starts an episode.

        Args:
            robot: what the robot knows in this episode.
            rng: draws the places to compare.
        """
        self._robot, self._rng = robot, rng
        self._stride_m, self._bins = robot.stride_m, robot.view_bins
        self._frontiers = Frontiers(robot.seen_floor)
        self.goal_m: Float[np.ndarray, "2"] | None = None
        """Where it heads for, None if no view within reach has any gain."""

    def act(self, info: dict[str, Any], priorities: Priorities = DEFAULT_PRIORITIES) -> Float32[np.ndarray, "4"]:
        """The action that makes a stride towards the best view, and takes the best look from there.

        Args:
            info: of the latest step.
            priorities: what counts more or less this time.
        """
        agent = info["agent"]
        position_m, yaw_rad = agent["position_m"], agent["yaw_rad"]
        frontiers = self._note_failed_looks(agent["camera_to_world"], yaw_rad)
        targets = self._targets(frontiers, priorities)
        goal_m = self.goal_m = self._best_place(targets, info)
        if goal_m is None:
            goal_m = self._frontiers.next_goal(self._robot.navigable, position_m, yaw_rad, self._rng)
        step_m = advance(self._robot.navigable, position_m, goal_m, self._stride_m)
        if step_m is None:
            self._frontiers.give_up(goal_m)
            step_m = np.zeros(2)
        after_m = position_m + step_m
        ahead_rad = bearing_rad(position_m, goal_m) if np.any(step_m) else yaw_rad + TURN_RAD
        # Of equally good directions the one nearest to where it goes.
        value = self._gains(targets, after_m[None])[0] - 1e-3 * np.abs(wrap(HEADINGS_RAD - ahead_rad))
        if not info["confirmed_objects"]:
            turns = np.abs(wrap(HEADINGS_RAD - yaw_rad))
            value = np.where(turns <= TURN_RAD + 0.5 * np.pi / len(HEADINGS_RAD), value, -np.inf)
        heading_rad = float(HEADINGS_RAD[np.argmax(value)])
        tilt_rad = self._tilt_rad(targets, after_m, heading_rad)
        return move_and_look(info, self._stride_m, step_m, heading_rad, tilt_rad).astype(np.float32)

    def _note_failed_looks(self, camera_to_world: Float[np.ndarray, "4 4"], yaw_rad: float) -> list[Frontier]:
        """Notes the frontiers that the camera points at, that nothing known hides and that are unseen all the same.

        Returns:
            The frontiers left.
        """
        eye_m, before = camera_to_world[:3, 3], self._frontiers.remaining()
        any_failed = False
        for frontier in before:
            centre_m = np.array([*frontier.place_m, FLOOR_EYE_M])
            near = float(np.linalg.norm(frontier.place_m - eye_m[:2])) < self._robot.max_depth_m
            in_view = abs(wrap(bearing_rad(eye_m[:2], frontier.place_m) - yaw_rad)) < IN_VIEW_RAD
            if near and in_view and self._robot.seen_space.sees(eye_m[None], centre_m, self._stride_m)[0]:
                self._frontiers.note_failed_look(frontier.place_m)
                any_failed = True
        return self._frontiers.remaining() if any_failed else before

    # Gains --------------------------------------------------------------------------------------------------------

    def _targets(self, frontiers: list[Frontier], priorities: Priorities) -> list[_Target]:
        """Confirmed objects, candidates and frontiers."""
        found, looked = [], self._robot.view_history
        for known in self._robot.objects:
            value = priorities.sides
            short_m = stop_short(float(np.max(known.extent_m)))
            done = known.cells | looked.tried(known.object_id)
            bins = self._value_of_bins(value, NEW_CELL * value, known.azimuths, done)
            found.append(_Target(known.centroid_m, short_m, bins))
        for one in looked.candidates:
            value = priorities.candidates * CANDIDATE * confirmation_score(one)
            bins = self._value_of_bins(value, value, set(), one.looks)
            found.append(_Target(one.centroid_m, stop_short(one.size_m), bins))
        for frontier in frontiers:
            value = priorities.floor * FRONTIER_PER_STRIDE2 * frontier.unseen_m2 / self._stride_m**2
            centre_m, bins = np.array([*frontier.place_m, FLOOR_EYE_M]), np.full(self._bins.shape, value)
            found.append(_Target(centre_m, self._stride_m, bins, binned=False))
        return found

    def _value_of_bins(
        self, value: float, detail: float, sectors: set[int], done: set[Cell]
    ) -> Float[np.ndarray, "sectors ranges elevations"]:
        """Gain of views of an object: less in sectors it was seen from, nothing in the very same bins."""
        table = np.full(self._bins.shape, value)
        table[sorted(sectors)] = detail
        if done:
            table[tuple(np.array(sorted(done)).T)] = 0.0
        return table

    def _gains(self, targets: list[_Target], places_m: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p d"]:
        """The expected gain of a look from each place in each of ``HEADINGS_RAD``."""
        if not targets:
            return np.zeros((len(places_m), len(HEADINGS_RAD)))
        eyes_m = np.column_stack([places_m, np.full(len(places_m), self._robot.camera_height_m)])
        centres_m = np.array([target.centre_m for target in targets])
        short_m = np.array([target.stop_short_m for target in targets])
        values = self._values(targets, eyes_m)
        space = self._robot.seen_space.grid
        return expected_gains(values, eyes_m, centres_m, short_m, HEADINGS_RAD, IN_VIEW_RAD, *space, CLEAR_M)

    def _values(self, targets: list[_Target], eyes_m: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "t p"]:
        """Gain of seeing each target from each place, if nothing hides it."""
        centres_m = np.array([target.centre_m for target in targets])[:, None]
        binned = np.array([target.binned for target in targets])[:, None]
        distances_m = np.linalg.norm(eyes_m[:, :2] - centres_m[..., :2], axis=-1)
        inside, bins = self._bins.cells(eyes_m, centres_m)
        value = np.array([target.value_of_bins for target in targets])[np.arange(len(targets))[:, None], *bins]
        return np.where(np.where(binned, inside, distances_m < self._robot.max_depth_m), value, 0.0)

    # Where to go ------------------------------------------------------------------------------------------------------

    def _best_place(self, targets: list[_Target], info: dict[str, Any]) -> Float[np.ndarray, "2"] | None:
        """The place within reach whose best view has the highest utility; None if no view has any gain."""
        agent = info["agent"]
        reach_m = BANDS_STRIDES[-1] * self._stride_m
        places_m, lengths_m = reachable_places(self._robot.navigable, agent["position_m"], self._stride_m, reach_m)
        chosen = self._candidate_places(places_m, lengths_m)
        places_m, lengths_m = places_m[chosen], lengths_m[chosen]
        gains = self._gains(targets, places_m)
        steps = np.maximum(1.0, np.ceil(lengths_m / self._stride_m - 1e-6))[:, None]
        gains = np.where(steps <= self._robot.views_left, gains, 0.0)
        if not info["confirmed_objects"]:
            steps = np.maximum(steps, np.ceil(np.abs(wrap(HEADINGS_RAD - agent["yaw_rad"])) / TURN_RAD - 0.1))
        # Of equally good views the one with the shortest path.
        utility = gains * np.exp(-PATH_COST * steps) - 1e-4 * lengths_m[:, None] / self._stride_m
        best = int(np.argmax(utility.max(axis=1)))
        return places_m[best] if gains[best].max() > 0.0 else None

    def _candidate_places(
        self, places_m: Float[np.ndarray, "n 2"], lengths_m: Float[np.ndarray, "n"]
    ) -> Int[np.ndarray, "k"]:
        """Which places to compare: where it is, what it headed for last time, and some of each band of distances."""
        chosen = [0]
        if self.goal_m is not None:
            chosen.append(int(np.argmin(np.sum((places_m - self.goal_m) ** 2, axis=1))))
        strides, low = lengths_m / self._stride_m, 0.0
        for high in BANDS_STRIDES:
            band = np.flatnonzero((strides > low) & (strides <= high))
            chosen.extend(self._rng.permutation(band)[:PLACES_PER_BAND])
            low = high
        return np.unique(chosen)

    def _tilt_rad(self, targets: list[_Target], place_m: Float[np.ndarray, "2"], yaw_rad: float) -> float:
        """Up or down to the targets in that direction."""
        eye_m = np.array([*place_m, self._robot.camera_height_m])
        tilts, weights = [self._robot.rest_tilt_rad], [0.1]
        targets = [target for target in targets if target.binned]
        values = self._values(targets, eye_m[None])[:, 0] if targets else []
        for target, value in zip(targets, values, strict=True):
            if value > 0.0 and abs(wrap(bearing_rad(place_m, target.centre_m) - yaw_rad)) < IN_VIEW_RAD:
                distance_m = float(np.linalg.norm(target.centre_m[:2] - place_m))
                tilts.append(float(np.arctan2(target.centre_m[2] - eye_m[2], max(distance_m, 1e-6))))
                weights.append(float(value))
        return float(np.average(tilts, weights=weights))
