import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sbm_gym.worlds.rooms.floor_plan import PROGRAMMES, ROOM_KINDS, complement, draw_plan
from sbm_gym.worlds.rooms.room_kinds import FURNISH


def area(rectangles):
    return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in rectangles)


def covers(rectangle, point):
    x0, y0, x1, y1 = rectangle
    return x0 < point[0] < x1 and y0 < point[1] < y1


@st.composite
def holes(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    corners = rng.integers(0, 12, (draw(st.integers(0, 5)), 2, 2))
    low, high = corners.min(axis=1), corners.max(axis=1) + 1
    return [(float(a), float(b), float(c), float(d)) for (a, b), (c, d) in zip(low, high, strict=True)], rng


@given(holes())
def test_a_complement_covers_exactly_what_the_holes_leave(case):
    found, rng = case
    bounds = (-1.0, -1.0, 14.0, 14.0)
    solid = complement(found, bounds)
    for point in rng.uniform(-1, 14, (60, 2)):
        open_ = any(covers(hole, point) for hole in found)
        assert sum(covers(piece, point) for piece in solid) == (0 if open_ else 1)


@settings(max_examples=40)
@given(st.sampled_from(list(PROGRAMMES)), st.integers(0, 2**32 - 1))
def test_plans_hang_together(kind, seed):
    plan = draw_plan(kind, np.random.default_rng(seed))
    assert tuple(sorted(room.kind for room in plan.rooms)) in {tuple(sorted(p)) for p in PROGRAMMES[kind]}
    reached, frontier = {0}, [0]
    while frontier:
        here = frontier.pop()
        for passage in plan.passages:
            if here in passage.rooms:
                other = sum(passage.rooms) - here
                if other not in reached:
                    reached.add(other)
                    frontier.append(other)
    assert len(reached) == len(plan.rooms)
    # Rooms, doorways and walls tile the bounds: nothing overlaps, nothing is left over.
    assert area(plan.open_rectangles()) + area(plan.solid_rectangles()) == pytest.approx(area([plan.bounds]))


@settings(max_examples=40)
@given(st.sampled_from(list(PROGRAMMES)), st.integers(0, 2**32 - 1))
def test_doorways_are_openings_of_both_rooms_and_wide_enough(kind, seed):
    plan = draw_plan(kind, np.random.default_rng(seed))
    for passage in plan.passages:
        x0, y0, x1, y1 = passage.rectangle
        assert max(x1 - x0, y1 - y0) >= 0.85
        for index in passage.rooms:
            room = plan.rooms[index]
            gaps = []
            for opening in room.openings:
                if opening.kind == "passage":
                    wall = room.walls()[opening.wall]
                    gaps.append(wall.point(0.5 * (opening.start_m + opening.end_m), 0.0))
            assert min(np.linalg.norm(gap - passage.middle_m) for gap in gaps) < 0.07
    doors = [o for room in plan.rooms for o in room.openings if o.kind == "door"]
    assert len(doors) == 1


@settings(max_examples=40)
@given(st.sampled_from(list(PROGRAMMES)), st.integers(0, 2**32 - 1))
def test_openings_stay_inside_their_walls_and_apart(kind, seed):
    plan = draw_plan(kind, np.random.default_rng(seed))
    for room in plan.rooms:
        for wall in room.walls():
            spans = sorted((o.start_m, o.end_m) for o in room.openings if o.wall == wall.index)
            assert all(0 < a < b < wall.length_m for a, b in spans)
            assert all(b < c for (_, b), (c, _) in itertools.pairwise(spans))


def test_all_kinds_of_rooms_can_be_furnished():
    assert {room for programmes in PROGRAMMES.values() for rooms in programmes for room in rooms} == set(ROOM_KINDS)
    assert set(FURNISH) == set(ROOM_KINDS)


@settings(max_examples=25)
@given(st.sampled_from(list(PROGRAMMES)), st.integers(0, 2**32 - 1))
def test_door_leaves_stand_beside_their_doorway_clear_of_windows_and_doorways(kind, seed):
    plan = draw_plan(kind, np.random.default_rng(seed))
    hung = 0
    for room in plan.rooms:
        walls = room.walls()
        for leaf in room.leaves:
            hung += 1
            corners = leaf.corners()
            assert np.all(corners > room.low_m)
            assert np.all(corners < room.high_m)
            # Its hinge is at a jamb of one of the room's narrow doorways.
            hinge = np.array([leaf.x_m, leaf.y_m]) - leaf.half_x_m * np.array(
                [np.cos(leaf.yaw_rad), np.sin(leaf.yaw_rad)]
            )
            jambs = [
                walls[o.wall].point(at, 0.0)
                for o in room.openings
                if o.kind == "passage"
                for at in (o.start_m, o.end_m)
            ]
            assert min(np.linalg.norm(hinge - jamb) for jamb in jambs) < 0.1
            for opening in room.openings:
                # No point of it lies before an opening, nearer than the leaf is wide (windows: than a curtain).
                wall = walls[opening.wall]
                t = np.linspace(0, 1, 21)[:, None]
                rim = np.concatenate([a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])
                along, out = (rim - wall.origin) @ wall.along, (rim - wall.origin) @ wall.normal
                before = (along > opening.start_m) & (along < opening.end_m)
                assert not np.any(before & (out < (0.3 if opening.kind == "window" else 0.9)))
    narrow = sum(max(q.rectangle[2] - q.rectangle[0], q.rectangle[3] - q.rectangle[1]) < 1.1 for q in plan.passages)
    assert hung <= narrow
