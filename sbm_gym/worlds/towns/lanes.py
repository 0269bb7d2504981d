"""Lanes of a town and ways through them: vehicles keep to the right, and turn at junctions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from sbm_gym.worlds.geometry.navigable import NavigableMap
from sbm_gym.worlds.geometry.placing import Box, overlap
from sbm_gym.worlds.moving.movers import Crossing, Mover
from sbm_gym.worlds.moving.route import Route, rounded
from sbm_gym.worlds.towns.plan import CORNER_M, LANE_M, Segment, Street

WHEELBASE_SHARE = 0.6
"""Distance between the axles, as a share of a vehicle's length."""
WAIT_M = 1.0
"""Vehicles wait so far before a junction."""
SPEED_M_S = (1.5, 4.5)
"""Least and greatest speed of vehicles: streets in which people walk."""
AHEAD_M = 1.5
"""Vehicles keep this far from what is before them."""
ROUTE_TRIALS = 40
"""How many ways are tried for a vehicle."""
ROUTES_COMPARED = 8
"""Of those that are free, that many are compared by how long they are near."""
NEAR_M = 14.0
"""Ways are preferred that lead past the middle of an episode, as near as this."""
EDGE_M = 0.25
"""Whether there is room for a vehicle is looked at in points of its outline so far apart."""


@dataclass(frozen=True)
class Lane:
    """One direction of a street between two neighbouring junctions."""

    start_m: Float[np.ndarray, "2"]
    end_m: Float[np.ndarray, "2"]
    """In the middle of the lane, in line with the kerbs of the crossing streets."""
    from_junction: int
    to_junction: int
    segment: int
    """Both directions of a street's part have the same number: nobody turns back."""


def lanes_of(segments: Sequence[Segment]) -> tuple[Lane, ...]:
    """The lanes of a town's streets."""
    streets: list[Street] = []
    for segment in segments:
        if segment.street not in streets:
            streets.append(segment.street)

    def junction(street: Street, kerb_m: float, is_start: bool) -> int:
        crossing = next(
            k
            for k, other in enumerate(streets)
            if other.axis != street.axis and abs((other.high_m if is_start else other.low_m) - kerb_m) < 1e-9
        )
        first, second = sorted((streets.index(street), crossing))
        return first * len(streets) + second

    lanes = []
    for number, segment in enumerate(segments):
        street = segment.street
        ends = (junction(street, segment.start_m, True), junction(street, segment.end_m, False))
        for forward in (True, False):
            across = street.right_side(forward) * LANE_M / 2
            points = street.point(np.array([segment.start_m, segment.end_m]), across)
            order = (0, 1) if forward else (1, 0)
            lanes.append(Lane(points[order[0]], points[order[1]], ends[order[0]], ends[order[1]], number))
    return tuple(lanes)


def drive(
    lanes: Sequence[Lane],
    free: NavigableMap,
    taken: Sequence[Box],
    centre_m: Float[np.ndarray, "2"],
    vehicle: Mover,
    seconds: float,
    rng: np.random.Generator,
) -> Mover | None:
    """Sends a vehicle on a way through a town.

    Args:
        lanes: of the town.
        free: where nothing stands still; what blocks the robot blocks vehicles, too.
        taken: floor that other vehicles cover when they set out.
        centre_m: middle of the episode.
        vehicle: the vehicle, with its speed; its route is replaced.
        seconds: how long it drives.
        rng: draws the way.

    Returns:
        None if no way was found that is free.
    """
    best, best_worth, found = None, -1.0, 0
    needed_m = vehicle.speed_m_s * seconds + vehicle.size_m[1]
    passable = [lane for lane in lanes if _is_passable(lane, vehicle, free)]
    for _ in range(ROUTE_TRIALS if passable else 0):
        route, passed = _draw_route(passable, needed_m, rng)
        sent = replace(vehicle, route=route)
        if any(overlap(sent.box(0.0), box, AHEAD_M) for box in taken) or not _has_room(sent, free):
            continue
        along = np.linspace(0.0, min(needed_m, sent.end_m), 40)
        near = float(np.mean(np.linalg.norm(route.at(along) - centre_m, axis=1) < NEAR_M))
        # Ways that end early, where all lanes onward are taken, are worth less.
        worth = (0.1 + near) * min(1.0, sent.end_m / needed_m)
        found += 1
        if worth > best_worth:
            overhang_m = 0.5 * (sent.size_m[1] - sent.wheelbase_m)
            best, best_worth = replace(sent, crossings=_crossings(sent, passed, overhang_m)), worth
        if found == ROUTES_COMPARED:
            break
    return best


def _is_passable(lane: Lane, vehicle: Mover, free: NavigableMap) -> bool:
    """Whether a vehicle can drive through a lane from end to end."""
    return _has_room(replace(vehicle, route=Route(np.stack([lane.start_m, lane.end_m]))), free)


def _draw_route(
    lanes: Sequence[Lane], length_m: float, rng: np.random.Generator
) -> tuple[Route, list[tuple[Lane, Lane]]]:
    """A random way of at least this length, if it does not end in a dead end; and the lanes on both sides of each
    junction on it.
    """
    lane = lanes[int(rng.integers(len(lanes)))]
    start = lane.start_m + rng.uniform(0.05, 0.6) * (lane.end_m - lane.start_m)
    corners, cuts, passed = [start], [], []
    left_m = length_m
    while True:
        last = corners[-1]
        span_m = float(np.linalg.norm(lane.end_m - last))
        choices = [one for one in lanes if one.from_junction == lane.to_junction and one.segment != lane.segment]
        if span_m >= left_m or not choices:
            corners.append(lane.end_m)
            return Route(rounded(corners, cuts)), passed
        after = choices[int(rng.integers(len(choices)))]
        passed.append((lane, after))
        corner, cut_m = _corner(lane, after)
        left_m -= span_m + float(np.linalg.norm(after.start_m - lane.end_m))
        if cut_m > 0.0:
            corners.append(corner)
            cuts.append(cut_m)
        lane = after


def _corner(lane: Lane, after: Lane) -> tuple[Float[np.ndarray, "2"], float]:
    """Where the middle lines of two lanes meet, and how far before and behind it vehicles turn; 0 if they go straight
    on.
    """
    way, onward = lane.end_m - lane.start_m, after.end_m - after.start_m
    if abs(way[0] * onward[1] - way[1] * onward[0]) < 1e-6:
        return lane.end_m, 0.0
    corner = np.where(np.abs(way) > np.abs(onward), after.start_m, lane.end_m)
    before_m = float(np.linalg.norm(corner - lane.end_m))
    behind_m = float(np.linalg.norm(after.start_m - corner))
    return corner, min(before_m, behind_m) + CORNER_M


def _crossings(vehicle: Mover, passed: Sequence[tuple[Lane, Lane]], overhang_m: float) -> tuple[Crossing, ...]:
    """Where a vehicle has junctions to itself: from before its front enters one until its back has left it."""
    found, done_m = [], 0.0
    for lane, after in passed:
        enters_m = vehicle.route.nearest(lane.end_m, done_m)
        leaves_m = done_m = vehicle.route.nearest(after.start_m, enters_m)
        start_m = enters_m - vehicle.wheelbase_m - overhang_m - WAIT_M
        found.append(Crossing(start_m, leaves_m + overhang_m, lane.to_junction))
    return tuple(found)


def _has_room(vehicle: Mover, free: NavigableMap) -> bool:
    """Whether a vehicle meets nothing that stands still, all the way."""
    along_x = _spread(-vehicle.size_m[0] / 2, vehicle.size_m[0] / 2)
    along_y = _spread(-vehicle.size_m[1] / 2, vehicle.size_m[1] / 2)
    outline = np.concatenate(
        [np.stack([np.full_like(along_y, x), along_y], axis=1) for x in (along_x[0], along_x[-1])]
        + [np.stack([along_x, np.full_like(along_x, y)], axis=1) for y in (along_y[0], along_y[-1])]
    )
    poses = np.array([vehicle.pose(float(along_m)) for along_m in np.arange(0.0, vehicle.end_m + EDGE_M, 2 * EDGE_M)])
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    points = np.einsum("pij,nj->pni", turn, outline) + poses[:, None, :2]
    return bool(free.are_free(points).all())


def _spread(low: float, high: float) -> Float[np.ndarray, "n"]:
    return np.linspace(low, high, int(np.ceil((high - low) / EDGE_M)) + 1)
