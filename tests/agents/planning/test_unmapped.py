"""What a robot without a map goes by: what it has seen and what it has run into, never the map."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from scipy import ndimage

from agents.planning.choices import ACTION_SPACE, DIRECTIONS, chosen_action
from agents.planning.promises import UNMAPPED, knowledge_for, with_promises
from agents.planning.unmapped import AHEAD_STRIDES, Unmapped
from agents.policies.next_best_view import NextBestView
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.worlds.geometry.navigable import AGENT_RADIUS_M, NavigableMap

from ..walled_rooms import WalledRooms

SIDE_M, STRIDE_M, CELL_M = 8.0, 0.5, 0.1
HERE_M = np.array([4.02, 4.02])


def robot_that_saw(boxes=()) -> Any:
    """A robot in an open square that has seen boxes, given by their least and greatest corners, and no floor yet."""
    navigable = NavigableMap(np.ones((160, 160), bool), np.zeros(2))
    space = SeenSpace(np.zeros(2), np.full(2, SIDE_M), CELL_M)
    filled, origin_m, cell_m = space.grid
    for low_m, high_m in boxes:
        first, last = (np.rint((np.array(corner) - origin_m) / cell_m).astype(int) for corner in (low_m, high_m))
        filled[first[0] : last[0], first[1] : last[1], first[2] : last[2]] = True
    return SimpleNamespace(
        **dict.fromkeys(("rest_tilt_rad", "max_depth_m", "ring_m", "ring_clearance_m", "view_history")),
        **dict.fromkeys(("search_distance_m", "view_bins", "objects", "target", "beliefs")),
        stride_m=STRIDE_M,
        camera_height_m=1.5,
        seen_space=space,
        seen_floor=SeenFloor(navigable, HERE_M, STRIDE_M, 5.0),
    )


def info_at(place_m, collided=False, yaw_rad=0.0) -> dict[str, Any]:
    return {"agent": {"position_m": np.asarray(place_m, float), "yaw_rad": yaw_rad}, "collided": collided}


def test_the_body_keeps_clear_of_what_was_seen_between_floor_and_head():
    wall = ((5.0, 2.0, 0.3), (5.1, 6.0, 1.2))
    carpet, lamp = ((2.0, 2.0, 0.0), (3.0, 3.0, 0.1)), ((2.0, 5.0, 2.0), (3.0, 6.0, 2.3))
    known = Unmapped(robot_that_saw([wall, carpet, lamp]), info_at(HERE_M)).navigable
    assert not known.is_free(np.array([5.05, 4.0]))
    assert not known.is_free(np.array([5.0 - AGENT_RADIUS_M + 0.02, 4.0]))
    assert known.is_free(np.array([5.0 - AGENT_RADIUS_M - 2.0 * CELL_M, 4.0]))
    assert known.is_free(np.array([2.5, 2.5]))
    assert known.is_free(np.array([2.5, 5.5]))
    for outside in ([0.05, 4.0], [-0.05, 4.0], [4.0, SIDE_M - 0.05], [20.0, 4.0]):
        assert not known.is_free(np.array(outside))


def test_floor_is_hoped_for_a_little_beyond_what_was_seen_and_not_through_walls():
    wall = ((4.6, 0.0, 0.1), (4.7, SIDE_M, 1.5))
    robot = robot_that_saw([wall])
    floor = Unmapped(robot, info_at(HERE_M)).seen_floor
    rows, columns = np.nonzero(floor.is_floor)
    centres_m = floor.centre_m(np.column_stack([rows, columns]))
    assert centres_m[:, 0].max() < 4.6
    seen_m = floor.centre_m(np.argwhere(robot.seen_floor.seen_at >= 0))
    seen_m = seen_m[seen_m[:, 0] < 4.6 - AGENT_RADIUS_M]
    nearest_m = np.linalg.norm(centres_m[:, None] - seen_m[None], axis=2).min(axis=1)
    # A step from cell to cell is up to the square root of two of its side.
    assert 0.9 * AHEAD_STRIDES * STRIDE_M - floor.cell_m < nearest_m.max() < np.sqrt(2.0) * AHEAD_STRIDES * STRIDE_M
    unseen = floor.unseen()
    assert unseen.any()
    assert np.array_equal(floor.is_floor & ~unseen, floor.is_floor & (robot.seen_floor.seen_at >= 0))


@pytest.mark.parametrize("yaw_rad", [0.0, 2.1, -1.3])
@pytest.mark.parametrize("forward_left", [(1.0, 0.0), (0.0, 0.6), (-1.0, -1.0)])
def test_what_it_runs_into_is_in_the_way_from_then_on(yaw_rad, forward_left):
    known = Unmapped(robot_that_saw(), info_at(HERE_M, yaw_rad=yaw_rad))
    angle = yaw_rad + np.arctan2(forward_left[1], forward_left[0])
    ahead = np.array([np.cos(angle), np.sin(angle)])
    goal_m = HERE_M + STRIDE_M * min(1.0, float(np.hypot(*forward_left))) * ahead
    assert known.navigable.line_is_free(HERE_M, goal_m)
    known.note_action(np.array([*forward_left, 0.0, 0.0]), info_at(HERE_M, yaw_rad=yaw_rad))
    stopped_m = HERE_M + 0.05 * ahead
    known.update(info_at(stopped_m, collided=True, yaw_rad=yaw_rad))
    assert known.navigable.is_free(stopped_m)
    assert not known.navigable.line_is_free(stopped_m, goal_m)
    assert known.navigable.line_is_free(stopped_m, stopped_m - STRIDE_M * ahead)
    free = known.navigable.free.copy()
    known.update(info_at(stopped_m, collided=True, yaw_rad=yaw_rad))  # the same view again: no other move was made
    assert np.array_equal(free, known.navigable.free)


def test_an_arrival_marks_nothing():
    known = Unmapped(robot_that_saw(), info_at(HERE_M))
    free = known.navigable.free.copy()
    known.note_action(np.array([1.0, 0.0, 0.0, 0.0]), info_at(HERE_M))
    known.update(info_at(HERE_M + np.array([STRIDE_M, 0.0])))
    assert np.array_equal(free, known.navigable.free)


class _NoMap:
    """What a robot knows, but for its map."""

    def __init__(self, robot: Any) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> Any:
        assert name != "navigable", "the map was asked for"
        return getattr(self._robot, name)


def episode(env: gym.Env, act: Any, start: Any):
    """Steps of an episode of a robot that must not ask for its map; yields its true map and what it goes by."""
    observation, info = env.reset(seed=4)
    true = env.get_wrapper_attr("knowledge")
    robot = start(_NoMap(true), info)
    for _ in range(25):
        yield true, robot
        observation, *_, info = env.step(act(robot, observation, info))


@pytest.mark.slow
def test_the_map_is_never_asked_for_and_what_takes_its_place_has_no_phantoms():
    env, rng = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=WalledRooms(), colours=False), np.random.default_rng(0)
    policy = NextBestView("unmapped")

    def start(robot, info):
        policy.robot, policy.rng = robot, rng
        policy.start(info)
        return policy._unmapped

    def drawn(robot, observation, info):
        with_promises(observation, info, robot, UNMAPPED)
        return chosen_action(rng.integers(ACTION_SPACE.nvec), info, robot)

    for act, begin in (
        (lambda _, seen, info: policy.act(seen, info), start),
        (drawn, partial(knowledge_for, UNMAPPED)),
    ):
        blocked = 0
        for true, known in episode(env, act, begin):
            free, run_into = known.navigable.free, np.asarray(known._run_into, bool)
            near = ndimage.binary_dilation(np.equal(true.navigable.free, False), iterations=3)
            places_m = known.navigable.origin_m + CELL_M * (np.argwhere(~free)[:, ::-1] + 0.5)
            far_from_furniture = NavigableMap(np.equal(near, False), true.navigable.origin_m).are_free(places_m)
            told_by_bumps = np.asarray(ndimage.binary_dilation(run_into, iterations=3), bool)[~free]
            assert np.all(told_by_bumps[far_from_furniture])
            blocked = np.count_nonzero(~told_by_bumps)
        assert blocked > 500


def test_moves_tell_whether_they_end_where_nothing_was_seen():
    env = gym.make("sbm_gym:sbm_gym/Indoor-v0", worlds=WalledRooms(), colours=False)
    observation, info = env.reset(seed=1)
    robot = knowledge_for(UNMAPPED, env.get_wrapper_attr("knowledge"), info)
    rows = with_promises(observation, info, robot, UNMAPPED)["moves"]
    assert rows.shape[0] == DIRECTIONS + 1
    assert rows[DIRECTIONS, -1] == 0.0
    assert set(rows[:, -1]) <= {0.0, 1.0}
    mapped = with_promises(observation, info, env.get_wrapper_attr("knowledge"))["moves"]
    assert rows.shape[1] == mapped.shape[1] + 1
