"""Rooms in which furniture is moved: pieces that stand elsewhere at every visit, and pieces that are carried about."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.worlds.geometry.navigable import AGENT_RADIUS_M, NavigableMap
from sbm_gym.worlds.geometry.placing import Placement, obstacle_rows, overlap, yaw_quaternion
from sbm_gym.worlds.moving.motion_config import MotionConfig
from sbm_gym.worlds.moving.movers import Mover
from sbm_gym.worlds.moving.route import Route
from sbm_gym.worlds.scene_builder import instance_of
from sbm_gym.worlds.world import Arrangement, ObjectInstance

LOOSE = ("chair", "plant", "beanbag", "nightstand", "table", "armchair", "tv")
"""Categories that people move about."""
MAX_LOOSE = 8
"""Pieces of a scene that can be moved: what can move is drawn at a higher cost."""
MAX_SIDE_M, MAX_HEIGHT_M = 1.0, 1.6
MAX_TRIANGLES = 8_000
SPEED_M_S = (0.25, 0.7)
"""Least and greatest speed of what is carried."""
TURN_RAD_M = 0.6
"""It turns by at most so much on each metre, either way."""
GAP_M = 0.06
"""Between what is moved and everything that stands, at least."""
START_CLEARANCE_M = 0.3
"""The robot starts no nearer than this to what will move."""
PLACE_TRIALS = 30
MIN_CELLS = 200
"""A piece that finds less room than this many cells of the floor map stays where it is."""
KEPT_SHARE = 0.95
"""Shifted pieces leave at least this share of the floor connected."""


@dataclass(frozen=True)
class MovablePiece:
    """A piece of furniture that stands loose."""

    piece: Placement
    """Where it belongs."""
    body_name: str
    instance_id: int
    footprint_m: Float[np.ndarray, "boxes 4"]
    """See ``FurnitureModel``."""

    @property
    def radius_m(self) -> float:
        """Of a circle around it."""
        return 0.5 * float(np.hypot(*self.piece.card.size_m[:2]))


def loose_pieces(pieces: Sequence[Placement], library: FurnitureLibrary) -> list[Placement]:
    """The pieces of a home that can be moved: small, light ones that stand on the floor and carry nothing; of every
    category as many as of the others, as far as there are so many.
    """
    carrying = [piece.on for piece in pieces if piece.on is not None]
    kinds: dict[str, list[Placement]] = {}
    for piece in pieces:
        width, depth, height = piece.card.size_m
        if (
            piece.card.category in LOOSE
            and piece.on is None
            and piece.z_m == 0.0
            and max(width, depth) <= MAX_SIDE_M
            and height <= MAX_HEIGHT_M
            and library.triangles(piece.card) <= MAX_TRIANGLES
            and not any(piece is one for one in carrying)
        ):
            kinds.setdefault(piece.card.category, []).append(piece)
    chosen: list[Placement] = []
    rank = 0
    while len(chosen) < MAX_LOOSE and any(len(found) > rank for found in kinds.values()):
        chosen += [found[rank] for _, found in sorted(kinds.items()) if len(found) > rank]
        rank += 1
    return chosen[:MAX_LOOSE]


@dataclass(frozen=True)
class RoomStage:
    """Moves the loose pieces of a home. Implements ``MovingStage``."""

    floor: NavigableMap
    """Where the robot could stand if no loose piece were there."""
    pieces: tuple[MovablePiece, ...]
    objects: tuple[ObjectInstance, ...]
    """All objects, where they belong."""

    def floor_around(self, pieces: Sequence[MovablePiece]) -> NavigableMap:
        """Where the robot could stand around some of the loose pieces."""
        boxes = (box for one in pieces for box in one.piece.footprint(one.footprint_m))
        return self.floor.without(obstacle_rows(boxes))

    def arrange(self, rng: np.random.Generator) -> Arrangement:
        """Everything where it belongs; draws nothing. Implements ``Stage``."""
        del rng
        return self._arrangement(self.pieces, self.floor_around(self.pieces))

    def set_in_motion(
        self, arrangement: Arrangement, rng: np.random.Generator, motion: MotionConfig, seconds: float
    ) -> Arrangement:
        """Draws pieces that are carried about and pieces that stand elsewhere, as many as there are. Implements
        ``MovingStage``.
        """
        del arrangement
        order = [self.pieces[int(k)] for k in rng.permutation(len(self.pieces))]
        carried, rest = order[: motion.moving], order[motion.moving :]
        shifted, staying = rest[: motion.shifted], rest[motion.shifted :]
        while True:
            floor, standing = self.floor_around(staying), list(staying)
            for one in shifted:
                moved = _shifted(one, floor, rng)
                floor = floor.without(obstacle_rows(moved.piece.footprint(moved.footprint_m)))
                standing.append(moved)
            movers: list[Mover] = []
            for one in carried:
                mover = _carried(one, floor, movers, motion.speed, seconds, rng)
                if mover is None:
                    break
                movers.append(mover)
            if len(movers) == len(carried):
                break
            # For this one there is no room; where it then stands, no other must be carried through.
            staying.append(carried.pop(len(movers)))
        start_boxes = obstacle_rows(mover.box(0.0) for mover in movers)
        found = self._arrangement(standing, floor)
        return replace(found, starts=found.navigable.without(start_boxes, START_CLEARANCE_M)).with_movers(movers, ())

    def _arrangement(self, standing: Sequence[MovablePiece], floor: NavigableMap) -> Arrangement:
        places = {one.instance_id: one for one in standing}
        objects = tuple(
            instance_of(places[one.instance_id].piece, one.instance_id, one.body_name)
            if one.instance_id in places
            else one
            for one in self.objects
        )
        navigable = floor.connected()
        return Arrangement(objects, navigable, navigable, functools.partial(_put, tuple(standing)))


def _put(pieces: Sequence[MovablePiece], model: mujoco.MjModel) -> None:
    """Brings loose pieces to their places in a compiled model."""
    for one in pieces:
        body = model.body(one.body_name).id
        model.body_pos[body] = [one.piece.x_m, one.piece.y_m, one.piece.z_m]
        model.body_quat[body] = yaw_quaternion(one.piece.yaw_rad)


def room_for(floor: NavigableMap, radius_m: float) -> NavigableMap:
    """Where a round thing can have its middle, given where the robot can.

    A circle is the union of circles of the robot's size in it, so it is free if all places for these are.
    """
    import cv2

    framed = np.pad(floor.free, 1).astype(np.uint8)
    to_taken_m = cv2.distanceTransform(framed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] * floor.cell_m
    # Distances are between middles of cells; any point of one may count, and the taken one begins half a cell nearer.
    needed_m = max(radius_m - AGENT_RADIUS_M, 0.0) + 1.5 * np.sqrt(2.0) * floor.cell_m
    return NavigableMap(floor.free & (to_taken_m >= needed_m), floor.origin_m, floor.cell_m).connected()


def _shifted(one: MovablePiece, floor: NavigableMap, rng: np.random.Generator) -> MovablePiece:
    """A piece somewhere else, if there is a place that leaves the floor connected; else where it was."""
    room = room_for(floor, one.radius_m + GAP_M)
    if np.count_nonzero(room.free) < MIN_CELLS:
        return one
    before = np.count_nonzero(floor.largest_component)
    for _ in range(PLACE_TRIALS):
        x, y = room.random_point(rng).tolist()
        yaw = float(rng.uniform(-np.pi, np.pi))
        moved = replace(one, piece=replace(one.piece, x_m=x, y_m=y, yaw_rad=yaw))
        left = floor.without(obstacle_rows(moved.piece.footprint(one.footprint_m)))
        own = np.pi * (one.radius_m + AGENT_RADIUS_M) ** 2 / floor.cell_m**2
        if np.count_nonzero(left.largest_component) >= KEPT_SHARE * before - own:
            return moved
    return one


def _carried(
    one: MovablePiece,
    floor: NavigableMap,
    others: Sequence[Mover],
    speed: float,
    seconds: float,
    rng: np.random.Generator,
) -> Mover | None:
    """A piece on its way through the rooms, from a free place on; None if there is too little room for it."""
    room = room_for(floor, one.radius_m + GAP_M)
    if np.count_nonzero(room.free) < MIN_CELLS:
        return None
    speed_m_s = float(rng.uniform(*SPEED_M_S))
    for _ in range(PLACE_TRIALS):
        points = [room.random_point(rng)]
        length_m = 0.0
        while length_m < speed_m_s * seconds + 0.5:
            way = room.shortest_path(points[-1], room.random_point(rng))
            if way is None:
                continue
            way = way[np.append(True, np.linalg.norm(np.diff(way, axis=0), axis=1) > 1e-6)]
            length_m += float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
            points += list(way[1:])
        mover = Mover(
            instance_id=one.instance_id,
            body_name=one.body_name,
            size_m=one.piece.card.size_m,
            route=Route(np.array(points)),
            speed_m_s=speed * speed_m_s,
            yaw_rad=float(rng.uniform(-np.pi, np.pi)),
            turn_rad_m=float(rng.uniform(-TURN_RAD_M, TURN_RAD_M)),
        )
        if not any(overlap(mover.box(0.0), other.box(0.0), 0.3) for other in others):
            return mover
    return None
