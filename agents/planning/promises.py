"""What each choice promises, as far as the robot knows: the rows of numbers that a policy of choices is told.

The observation tells of each move what it promises, ``MOVE_ENTRIES``, and of each look after each move, from where the
move ends, ``LOOK_ENTRIES``.
"""

import functools
from typing import Any

import numpy as np
from gymnasium import spaces
from jaxtyping import Float

from agents.planning.choices import DIRECTIONS, HEADINGS, LOOKS, STAY, free_step
from agents.planning.kernels import expected_gains, new_sides, unseen_by_way
from agents.planning.unmapped import Unmapped
from sbm_gym.env.gaze import TURN_RAD
from sbm_gym.env.state_vector import UNSEEN_STRIDES, likely_candidates, nearest_others, state_names
from sbm_gym.robot.angles import wrap
from sbm_gym.robot.knowledge import RobotKnowledge
from sbm_gym.robot.line_of_sight import stop_short
from sbm_gym.robot.object_memory import ViewBins
from sbm_gym.robot.seen_space import CLEAR_M
from sbm_gym.robot.view_history import IN_VIEW_RAD
from sbm_gym.worlds.geometry.grid_kernels import free_steps
from sbm_gym.worlds.geometry.navigable import NavigableMap

FARTHER_STRIDES = (2.0, 4.0)
"""How far from where the robot stands, straight on to the side of a move, new sides are looked for, too."""
KINDS = ("target", "others", "candidates")
"""Whose new sides are told apart."""
_SIDES = tuple(f"{kind}_new" for kind in KINDS)
MOVE_ENTRIES = (
    *("length", "aside", *_SIDES, *(f"{name}_{strides:g}_strides" for strides in FARTHER_STRIDES for name in _SIDES)),
    *("unseen_near", "unseen_far", "to_target", "to_other", "to_candidate_0", "to_candidate_1"),
    *("labels", *(f"labels_{strides:g}_strides" for strides in FARTHER_STRIDES), "unseen_by_way"),
)
"""What each move promises, as far as the robot knows: the share of a stride that it goes and of a quarter turn that it
is turned aside; then, at the place it ends at and farther on, whether a side of the target would be new, of how many
others one would be (divided by two) and how likely the candidates are that have not been looked at from there (in sum);
unseen floor on that side, as in ``state``; the cosine of the angle to things; by how many the labels that may be
expected to be right grow by the best look from there, as ``ObjectBeliefs`` has it (divided by ``MANY_LABELS``); how
much unseen floor there is on ways that begin on that side, less the longer the way (divided by
``MUCH_FLOOR_STRIDES2``)."""
LOOK_ENTRIES = (
    *("is_target", "is_candidate", "is_other", "is_turn", "there", "turn", "range", "confidence", "looks", "new"),
    *(*_SIDES, "unseen_near", "unseen_far", "labels", "chance"),
)
"""What each look promises: what it is of, and whether there is such a thing; how far the camera turns (divided by pi);
of things their range (divided by 16 strides), confidence, vain looks (divided by five) and whether the side of them
that shows from where the move ends is new; then what is new within the view from there, unseen floor and labels, as
for moves; of things the chance that they are what they are called."""
SUMMARY = (
    *("target_known", "target_visible", "target_range", "target_azimuths_covered", "target_confidence_now"),
    *("target_best_confidence", "other_0_known", "candidate_0_confidence", "objects_confirmed", "time_left"),
)
"""Entries of ``state`` that bear on all choices alike."""
UNMAPPED = "moves_and_looks_unmapped"
"""The wrapper for robots that are given no map; see ``Unmapped``."""
UNMAPPED_ENTRIES = ("into_the_unknown",)
"""What each move promises besides without a map: 1 if it ends where floor has not been seen."""
WITHOUT: dict[str, tuple[str, ...]] = {
    "moves_and_looks": (),
    UNMAPPED: (),
    "moves_and_looks_without_map": ("unseen_near", "unseen_far", "unseen_by_way"),
    "moves_and_looks_without_history": (
        *(name for name in MOVE_ENTRIES if name.startswith(("labels", "candidates_new"))),
        *("confidence", "looks", "new", "candidates_new", "labels", "chance"),
    ),
}
"""Entries of rows that are zero, by the name of the wrapper: none, or for ablations what the map of seen floor tells,
or what earlier looks at things do. The value network, which no policy needs, is told of the floor all the same."""
MANY_LABELS = 3.0
MUCH_FLOOR_STRIDES2 = 40.0
PATH_COST = 0.2
"""Unseen floor counts exp(-PATH_COST) for each stride of the way to it, as in the view planner."""
_RANGE_STRIDES = 16.0
_MANY_LOOKS = 5.0


def knowledge_for(name: str, robot: RobotKnowledge, info: dict[str, Any]) -> RobotKnowledge:
    """What the robot goes by in an episode.

    Args:
        name: one of ``WITHOUT``.
        robot: what it knows in this episode.
        info: what ``env.reset`` returned.
    """
    return Unmapped(robot, info) if name == UNMAPPED else robot


def observation_space(space: spaces.Space, wrapper: str = "moves_and_looks") -> spaces.Dict:
    """The observation space with what moves and looks promise.

    Args:
        space: that of the environment.
        wrapper: one of ``WITHOUT``.
    """
    assert isinstance(space, spaces.Dict)
    entries = len(MOVE_ENTRIES) + (len(UNMAPPED_ENTRIES) if wrapper == UNMAPPED else 0)
    moves = spaces.Box(-1.0, 1.0, (DIRECTIONS + 1, entries), np.float32)
    looks = spaces.Box(-1.0, 1.0, (DIRECTIONS + 1, len(LOOKS), len(LOOK_ENTRIES)), np.float32)
    summary = spaces.Box(-1.0, 1.0, (len(SUMMARY),), np.float32)
    return spaces.Dict({**space.spaces, "summary": summary, "moves": moves, "looks": looks})


def with_promises(
    observation: dict[str, Any], info: dict[str, Any], robot: RobotKnowledge, wrapper: str = "moves_and_looks"
) -> dict[str, Any]:
    """An observation with what each move and each look promises.

    Args:
        observation: of the environment.
        info: that came with it.
        robot: what it goes by, as ``knowledge_for`` has it.
        wrapper: one of ``WITHOUT``, which may leave some of it out.
    """
    if isinstance(robot, Unmapped):
        robot.update(info)
    agent = info["agent"]
    position_m, heading_rad = agent["position_m"], agent["yaw_rad"]
    things = _Things(robot, agent["camera_to_world"][:3, 3])
    angles = heading_rad + np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    steps_m = np.array([free_step(robot.navigable, position_m, robot.stride_m, angle) for angle in angles])
    lengths = np.linalg.norm(steps_m, axis=1) / robot.stride_m
    along = (steps_m * directions).sum(axis=1) / np.maximum(lengths * robot.stride_m, 1e-9)
    farther_m = robot.stride_m * np.array(FARTHER_STRIDES)
    free_m = _free_m(robot.navigable, position_m, directions, farther_m[-1])
    ends_m = position_m + np.concatenate([steps_m, np.zeros((1, 2))])  # in the order of moves
    far_m = position_m + (farther_m[:, None, None] * directions).reshape(-1, 2)
    places_m = np.concatenate([ends_m, far_m])
    new = things.new_from(places_m)
    labels = _labels_from(robot, places_m, heading_rad)
    is_free = np.concatenate([np.ones(DIRECTIONS + 1), (free_m >= farther_m[:, None]).ravel()])
    promised, best_labels = np.minimum(things.worth @ new, 1.0) * is_free, labels.max(axis=1) * is_free
    rings = tuple(UNSEEN_STRIDES.values())
    unseen = np.array([robot.seen_floor.unseen_around(end_m, heading_rad, rings, DIRECTIONS) for end_m in ends_m])

    moves = np.zeros((DIRECTIONS + 1, len(MOVE_ENTRIES)))
    moves[STAY, 2:5], moves[STAY, 17] = promised[:, STAY], best_labels[STAY]
    rows = moves[:DIRECTIONS]
    rows[:, 0], rows[:, 1] = lengths, np.arccos(np.clip(along, -1.0, 1.0)) / (0.5 * np.pi) * (lengths > 0.0)
    of_sides = np.delete(np.arange(len(places_m)), STAY).reshape(-1, DIRECTIONS)
    rows[:, 2:11] = promised[:, of_sides].transpose(2, 1, 0).reshape(DIRECTIONS, -1)
    rows[:, 11:13], rows[:, 17:20] = unseen[STAY].T, best_labels[of_sides].T
    for column, name in enumerate(("target", "other_0", "candidate_0", "candidate_1"), 13):
        index = things.index_of(name)
        if index is not None:
            rows[:, column] = np.cos(angles - things.bearings_rad(position_m[None])[0, index])
    floor = robot.seen_floor
    cell = floor.cell(robot.navigable.nearest_free(position_m))
    beyond = unseen_by_way(floor.is_floor, floor.unseen(), *cell, floor.cell_m / floor.stride_m, angles, PATH_COST)
    rows[:, 20] = np.minimum(beyond / MUCH_FLOOR_STRIDES2, 1.0)

    summary = observation["state"][_summary_indices(robot.view_bins)]
    looks = _looks_from(things, ends_m, heading_rad, robot.stride_m, new[:, : DIRECTIONS + 1], unseen, labels)
    for entries, values in ((MOVE_ENTRIES, moves), (LOOK_ENTRIES, looks)):
        values[..., [entries.index(name) for name in WITHOUT[wrapper] if name in entries]] = 0.0
    if wrapper == UNMAPPED:
        moves = np.column_stack([moves, ~floor.was_seen(ends_m)])
    rows = {"moves": moves.astype(np.float32), "looks": looks.astype(np.float32)}
    return {**observation, "summary": summary, **rows}


def _looks_from(
    things: "_Things",
    ends_m: Float[np.ndarray, "moves 2"],
    heading_rad: float,
    stride_m: float,
    new: Float[np.ndarray, "t moves"],
    unseen: Float[np.ndarray, "moves rings directions"],
    labels: Float[np.ndarray, "moves headings"],
) -> Float[np.ndarray, "moves looks entries"]:
    """What each look promises after each move.

    Args:
        things: that the robot knows of.
        ends_m: where moves end.
        heading_rad: where the camera points before.
        stride_m: the longest move.
        new: 1 where a thing shows a side that is new.
        unseen: unseen floor around the ends, in directions from ``heading_rad`` on.
        labels: see ``_labels_from``; there may be more places.
    """
    looks = np.zeros((len(ends_m), len(LOOKS), len(LOOK_ENTRIES)))
    ahead_rad = np.full(looks.shape[:2], heading_rad)
    bearings_rad, ranges_m = things.bearings_rad(ends_m), things.ranges_m(ends_m)
    for row, what in enumerate(LOOKS):
        index = things.index_of(what) if isinstance(what, str) else None
        kind = ("target", "candidate", "other").index(what.partition("_")[0]) if isinstance(what, str) else 3
        looks[:, row, kind] = 1.0
        if index is not None:
            ahead_rad[:, row] = bearings_rad[:, index]
            looks[:, row, 4] = 1.0
            looks[:, row, 6] = np.minimum(1.0, ranges_m[:, index] / (_RANGE_STRIDES * stride_m))
            looks[:, row, 7:9] = things.confidence[index], min(1.0, things.vain_looks[index] / _MANY_LOOKS)
            looks[:, row, 9], looks[:, row, 16] = new[index], things.chance[index]
        elif not isinstance(what, str):
            ahead_rad[:, row] += what
            looks[:, row, 4] = 1.0
    turns_rad = wrap(ahead_rad - heading_rad)
    if not things.any_confirmed:  # the camera turns by no more then, and the row tells of the view that comes of it
        turns_rad = np.clip(turns_rad, -TURN_RAD, TURN_RAD)
    looks[..., 5] = np.abs(turns_rad) / np.pi
    in_view = np.abs(wrap(bearings_rad[:, None] - heading_rad - turns_rad[..., None])) < IN_VIEW_RAD
    looks[..., 10:13] = np.minimum(np.einsum("kt,tm,mlt->mlk", things.worth, new, in_view), 1.0)
    moves, side = np.arange(len(ends_m))[:, None], turns_rad / (2.0 * np.pi)
    looks[..., 13:15] = unseen.transpose(0, 2, 1)[moves, np.rint(side * DIRECTIONS).astype(int) % DIRECTIONS]
    looks[..., 15] = labels[moves, np.rint(side * HEADINGS).astype(int) % HEADINGS]
    return looks


def _labels_from(
    robot: RobotKnowledge, places_m: Float[np.ndarray, "p 2"], heading_rad: float
) -> Float[np.ndarray, "p headings"]:
    """By how many the labels that may be expected to be right grow by looks from places, divided by ``MANY_LABELS``.

    Args:
        robot: what it knows.
        places_m: where the looks are taken from.
        heading_rad: the first direction of looks; the others follow counter-clockwise.
    """
    beliefs = robot.beliefs
    things = [one for one in beliefs.things if one.worth > 0.0]
    headings = heading_rad + np.arange(HEADINGS) * (2.0 * np.pi / HEADINGS)
    if not things:
        return np.zeros((len(places_m), HEADINGS))
    eyes_m = np.column_stack([places_m, np.full(len(places_m), robot.camera_height_m)])
    centres_m = np.array([one.centroid_m for one in things])
    short_m = np.array([stop_short(float(np.max(one.extent_m))) for one in things])
    worth, space = beliefs.worth_from(eyes_m, things), robot.seen_space.grid
    gains = expected_gains(worth, eyes_m, centres_m, short_m, headings, IN_VIEW_RAD, *space, CLEAR_M)
    return np.minimum(gains / MANY_LABELS, 1.0)


@functools.cache
def _summary_indices(bins: ViewBins) -> list[int]:
    names = state_names(bins)
    return [names.index(name) for name in SUMMARY]


class _Things:
    """What the robot knows of or suspects, as arrays: confirmed objects, then candidates."""

    def __init__(self, robot: RobotKnowledge, camera_m: Float[np.ndarray, "3"]):
        self._robot = robot
        others, candidates = nearest_others(robot, camera_m), likely_candidates(robot)
        target = [] if robot.target is None else [robot.target]
        self._names = [*("target" for _ in target), *(f"other_{k}" for k in range(len(others)))]
        self._names += [f"candidate_{k}" for k in range(len(candidates))]
        known = [*target, *others]
        self.any_confirmed = bool(known)
        count = len(self._names)
        self.centres_m = np.array([one.centroid_m for one in (*known, *candidates)]).reshape(-1, 3)
        sizes_m = [float(np.max(one.extent_m)) for one in known] + [one.size_m for one in candidates]
        self._short_m = stop_short(np.array(sizes_m))
        self._done = np.zeros((count, robot.view_bins.num_azimuths), bool)
        for row, cells in enumerate([*(one.cells for one in known), *(one.looks for one in candidates)]):
            self._done[row, [cell[0] for cell in cells]] = True
        self.confidence = [*(one.best_confidence for one in known), *(one.confidence for one in candidates)]
        self.chance = [robot.beliefs.chance_at(one.centroid_m) for one in (*known, *candidates)]
        self.vain_looks = [0] * len(known) + [len(one.looks) for one in candidates]
        self.worth = np.zeros((len(KINDS), count))
        """What a new side of each thing counts, kind by kind."""
        self.worth[0, : len(target)] = 1.0
        self.worth[1, len(target) : len(known)] = 0.5
        self.worth[2, len(known) :] = [one.confidence for one in candidates]

    def index_of(self, name: str) -> int | None:
        """Where a thing stands; None if there is none of that name."""
        return self._names.index(name) if name in self._names else None

    def bearings_rad(self, places_m: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p t"]:
        """Directions to the things from places, counter-clockwise from +X."""
        offsets = self.centres_m[:, :2] - places_m[:, None]
        return np.arctan2(offsets[..., 1], offsets[..., 0])

    def ranges_m(self, places_m: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p t"]:
        """Horizontal distances to the things from places."""
        offsets = self.centres_m[:, :2] - places_m[:, None]
        return np.hypot(offsets[..., 0], offsets[..., 1])

    def new_from(self, places_m: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "t p"]:
        """1 where a place shows a side of a thing that is new."""
        robot, edges_m = self._robot, self._robot.view_bins.range_edges_m
        eyes_m = np.column_stack([places_m, np.full(len(places_m), robot.camera_height_m)])
        space = robot.seen_space.grid
        ends_m = edges_m[0], edges_m[-1]
        found = new_sides(eyes_m, self.centres_m, self._short_m, self._done, *ends_m, *space, CLEAR_M)
        return found.astype(float)


def _free_m(
    navigable: NavigableMap, position_m: Float[np.ndarray, "2"], directions: Float[np.ndarray, "d 2"], most_m: float
) -> Float[np.ndarray, "d"]:
    """How far the straight way is free on each side."""
    most = int(np.ceil(most_m / navigable.cell_m))
    x, y = position_m.tolist()
    return navigable.cell_m * free_steps(navigable.free, navigable.origin_m, navigable.cell_m, x, y, directions, most)
