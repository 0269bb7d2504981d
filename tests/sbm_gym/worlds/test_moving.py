"""Routes, who waits for whom, and what moves in rooms and towns. Whether things touch, MuJoCo's geometry says."""

import functools

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.errors import UsageError
from sbm_gym.robot.body import BodyConfig, add_agent
from sbm_gym.scenes.world_sources import IndoorWorlds, OutdoorWorlds
from sbm_gym.worlds.geometry.navigable import navigable_map
from sbm_gym.worlds.geometry.placing import Box, obstacle_rows, overlap
from sbm_gym.worlds.moving.motion_config import MotionConfig
from sbm_gym.worlds.moving.movers import MARGIN_M, Crossing, Mover, Traffic
from sbm_gym.worlds.moving.route import Route, rounded
from sbm_gym.worlds.rooms.room_stage import room_for
from sbm_gym.worlds.towns.lanes import lanes_of
from sbm_gym.worlds.towns.plan import LANE_M, draw_plan
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION

FAR = np.array([1e3, 1e3])


def straight(start, end, **kwargs) -> Mover:
    known = {"instance_id": 1, "body_name": "one", "size_m": (1.8, 4.0, 1.5), "speed_m_s": 2.0, "wheelbase_m": 2.4}
    return Mover(route=Route(np.array([start, end], float)), **{**known, **kwargs})


# Routes ---------------------------------------------------------------------------------------------------------------


def test_a_rounded_corner_is_a_circle_that_touches_both_sides():
    line = rounded([np.array([0.0, 0.0]), np.array([10.0, 0.0]), np.array([10.0, 10.0])], [4.0])
    arc = line[1:-1]
    assert np.allclose(np.hypot(arc[:, 0] - 6.0, arc[:, 1] - 4.0), 4.0)
    assert np.allclose(arc[0], [6.0, 0.0])
    assert np.allclose(arc[-1], [10.0, 4.0])
    assert Route(line).length_m == pytest.approx(6 + 2 * np.pi + 6, rel=2e-3)


@settings(max_examples=40)
@given(st.floats(0.0, 20.0), st.floats(0.1, 3.0))
def test_both_axles_of_a_vehicle_are_on_its_route(along_m, wheelbase_m):
    line = rounded([np.array([0.0, 0.0]), np.array([10.0, 0.0]), np.array([10.0, 14.0])], [4.0])
    mover = straight([0, 0], [1, 0], wheelbase_m=wheelbase_m)
    mover = Mover(**{**vars(mover), "route": Route(line)})
    x, y, yaw = mover.pose(min(along_m, mover.end_m))
    # At yaw 0 the front looks towards -Y.
    ahead = np.array([np.sin(yaw), -np.cos(yaw)])
    dense = Route(line).at(np.linspace(0.0, Route(line).length_m, 4000))
    span_m = np.linalg.norm(Route(line).at(min(along_m, mover.end_m) + wheelbase_m) - Route(line).at(along_m))
    for side in (-0.5, 0.5):
        axle = np.array([x, y]) + side * span_m * ahead
        assert np.linalg.norm(dense - axle, axis=1).min() < 0.02


# Who waits ------------------------------------------------------------------------------------------------------------


def test_a_vehicle_goes_as_far_as_its_speed_says_and_stops_at_the_end_of_its_way():
    traffic = Traffic([straight([0, 0], [10, 0])], 0.2)
    traffic.advance(1.0, FAR)
    assert traffic.floor_poses()[0][:2] == pytest.approx((1.2 + 2.0, 0.0))
    for _ in range(10):
        traffic.advance(1.0, FAR)
    assert traffic.floor_poses()[0][0] == pytest.approx(10.0 - 1.2)


def test_it_stops_before_the_robot_and_goes_on_when_that_has_gone():
    traffic = Traffic([straight([0, 0], [40, 0], ahead_m=1.5)], 0.2)
    for _ in range(12):
        traffic.advance(1.0, np.array([15.0, 0.3]))
    front_m = traffic.floor_poses()[0][0] + 2.0
    assert 15.0 - 0.2 - 1.5 - 0.3 < front_m < 15.0 - 0.2 - 1.5 + 0.01
    traffic.advance(1.0, FAR)
    assert traffic.floor_poses()[0][0] == pytest.approx(front_m)


def test_one_vehicle_at_a_time_is_in_a_junction():
    movers = [
        straight([-20, 0], [20, 0], crossings=(Crossing(14.0, 28.0, 5),)),
        straight([0, -22], [0, 20], crossings=(Crossing(16.0, 30.0, 5),), instance_id=2),
    ]
    traffic = Traffic(movers, 0.2)
    inside = []
    for _ in range(50):
        traffic.advance(0.5, FAR)
        along = traffic._along_m
        inside.append([14.0 <= along[0] <= 28.0, 16.0 <= along[1] <= 30.0])
    assert not np.all(inside, axis=1).any()
    assert np.any(inside, axis=0).all()
    assert along[0] > 28.0
    assert along[1] > 30.0


def test_what_is_carried_goes_back_where_its_way_is_blocked_or_ends():
    carried = straight([0, 0], [3, 0], wheelbase_m=0.0, size_m=(0.5, 0.5, 0.9), ahead_m=0.1, speed_m_s=1.0)
    traffic = Traffic([carried], 0.2)
    x = []
    for _ in range(20):
        traffic.advance(0.5, np.array([2.0, 0.0]))
        x.append(traffic.floor_poses()[0][0])
    assert max(x) < 2.0 - 0.2 - 0.25
    assert min(x[4:]) < 0.2
    assert max(x[8:]) > 1.0


@pytest.mark.slow
@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_nothing_that_moves_ever_touches_anything_else_that_does(seed):
    rng = np.random.default_rng(seed)
    movers: list[Mover] = []
    for k in range(5):
        ends = rng.uniform(-8, 8, (2, 2))
        wheelbase_m = float(rng.choice([0.0, 1.0]))
        one = straight(*ends, instance_id=k, size_m=(0.8, 1.6, 1.0), wheelbase_m=wheelbase_m, turn_rad_m=0.4)
        if not any(overlap(one.box(0.0), other.box(0.0), 2 * MARGIN_M) for other in movers):
            movers.append(one)
    traffic, robot = Traffic(movers, 0.2), np.array([20.0, 20.0])
    for _ in range(25):
        place = rng.uniform(-8, 8, 2)
        if not traffic.is_near(place, place):
            robot = place
        traffic.advance(0.4, robot)
        boxes = [*traffic.boxes(), Box(float(robot[0]), float(robot[1]), 0.2, 0.2, 0.0)]
        assert not any(overlap(a, b, -1e-6) for k, a in enumerate(boxes) for b in boxes[:k])


# Rooms and towns ------------------------------------------------------------------------------------------------------

WORLDS = {
    "room": (IndoorWorlds(builtin=True, movable=True), "seed/3"),
    "town": (OutdoorWorlds(builtin=True), "town/seed/1"),
}


@functools.cache
def world(kind):
    source, scene = WORLDS[kind]
    return source.build(scene)


@functools.cache
def model(kind):
    spec = world(kind).bare
    add_agent(spec, BodyConfig())
    return spec.compile()


def in_motion(kind, seed, moving=4, shifted=0, speed=1.0):
    stage, rng = world(kind).stage, np.random.default_rng(seed)
    return stage.set_in_motion(stage.arrange(rng), rng.spawn(1)[0], MotionConfig(moving, shifted, speed), 20.0)


def touched_geoms(compiled, body):
    return np.flatnonzero((compiled.geom_bodyid == body) & (compiled.geom_group == GEOM_GROUP_COLLISION))


def nearest_m(compiled, data, geoms, others):
    """The least distance between two sets of geoms, found by MuJoCo."""
    middles, reach = data.geom_xpos, compiled.geom_rbound
    found = 1.0
    for one in geoms:
        near = [k for k in others if np.linalg.norm(middles[k] - middles[one]) < reach[k] + reach[one] + 0.1]
        found = min([found, *(mujoco.mj_geomDistance(compiled, data, one, k, 1.0, None) for k in near)])
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("kind", list(WORLDS))
def test_what_moves_touches_nothing_that_stands(kind, seed):
    arrangement, compiled = in_motion(kind, seed), model(kind)
    arrangement.apply(compiled)
    data = mujoco.MjData(compiled)
    traffic = Traffic(arrangement.movers, 0.18)
    bodies = [int(compiled.body(one.body_name).id) for one in arrangement.movers]
    assert len(bodies) >= 2
    agent = int(compiled.body("agent").id)
    solid = (compiled.geom_group == GEOM_GROUP_COLLISION) & (compiled.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    solid &= ~np.isin(compiled.geom_bodyid, [*bodies, agent])
    ground = compiled.geom_pos[:, 2] + compiled.geom_size[:, 2] <= 0.13  # floors and kerbs
    still = np.flatnonzero(solid & ~ground)
    assert len(still) > 20
    moved_m = 0.0
    for _ in range(20):
        for body, pose in zip(bodies, traffic.floor_poses(), strict=True):
            data.mocap_pos[compiled.body_mocapid[body]] = [*pose[:2], 0.0]
            data.mocap_quat[compiled.body_mocapid[body]] = [np.cos(pose[2] / 2), 0, 0, np.sin(pose[2] / 2)]
        mujoco.mj_forward(compiled, data)
        for body in bodies:
            others = np.append(still, np.concatenate([touched_geoms(compiled, b) for b in bodies if b != body]))
            assert nearest_m(compiled, data, touched_geoms(compiled, body), others) > 0.0
        before = traffic.poses()
        traffic.advance(0.8, FAR)
        moved_m += sum(float(np.linalg.norm(traffic.poses()[k][:3, 3] - before[k][:3, 3])) for k in before)
    assert moved_m > 4.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(WORLDS))
def test_motion_is_decided_by_the_seed_and_sets_out_from_where_it_would_stand_without_speed(kind):
    def told(arrangement):
        return [(m.instance_id, m.speed_m_s, m.route.points_m.tolist()) for m in arrangement.movers]

    one, same, other, halted = in_motion(kind, 5), in_motion(kind, 5), in_motion(kind, 6), in_motion(kind, 5, speed=0.0)
    assert told(one) == told(same)
    assert told(one) != told(other)
    assert [m[2] for m in told(one)] == [m[2] for m in told(halted)]
    traffic = Traffic(halted.movers, 0.2)
    start = traffic.floor_poses()
    traffic.advance(5.0, FAR)
    assert traffic.floor_poses() == start
    boxes = {o.instance_id: o.box_3d for o in one.objects}
    for mover in one.movers:
        assert np.allclose(boxes[mover.instance_id].centre_m[:2], mover.pose(0.0)[:2])
        assert not one.starts.is_free(np.array(mover.pose(0.0)[:2]))


@pytest.mark.slow
def test_a_child_of_the_generator_draws_what_moves_so_that_all_else_is_as_without():
    stage, rng, alike = world("town").stage, np.random.default_rng(3), np.random.default_rng(3)
    plain = stage.arrange(alike)
    moving = stage.set_in_motion(stage.arrange(rng), rng.spawn(1)[0], MotionConfig(3), 20.0)
    assert rng.bit_generator.state == alike.bit_generator.state
    assert [o.instance_id for o in moving.objects[: len(plain.objects)]] == [o.instance_id for o in plain.objects]
    assert np.array_equal(moving.navigable.free, plain.navigable.free)


@pytest.mark.slow
def test_loose_furniture_stands_where_fixed_furniture_does():
    fixed = IndoorWorlds(builtin=True).build("seed/3")
    loose = world("room")
    arrangement = loose.stage.arrange(np.random.default_rng(0))
    assert np.array_equal(arrangement.navigable.free, fixed.navigable.free)
    assert np.array_equal(loose.navigable.free, fixed.navigable.free)
    for one, other in zip(fixed.objects, arrangement.objects, strict=True):
        assert (one.instance_id, one.category, one.body_name) == (other.instance_id, other.category, other.body_name)
        assert np.allclose(one.box_3d.corners(), other.box_3d.corners())


def test_shifted_furniture_stands_elsewhere_in_its_own_room_and_on_the_map():
    home = {o.instance_id: o.box_3d for o in world("room").objects}
    for seed in range(3):
        found = in_motion("room", seed, moving=0, shifted=3)
        assert not found.movers
        moved = [o for o in found.objects if np.linalg.norm(o.box_3d.centre_m - home[o.instance_id].centre_m) > 0.05]
        assert 1 <= len(moved) <= 3
        assert not any(found.navigable.is_free(o.box_3d.centre_m[:2]) for o in moved if o.category != "table")
    with pytest.raises(UsageError, match="rooms"):
        in_motion("town", 0, shifted=1)


def test_a_circle_fits_wherever_the_map_for_it_says():
    rng = np.random.default_rng(0)
    rows = rng.uniform([-3, -3, 0.1, 0.1, -3], [3, 3, 0.6, 0.6, 3], (8, 5))
    boxes = [Box(x, y, half_x, half_y, yaw) for x, y, half_x, half_y, yaw in rows.tolist()]
    floor = navigable_map(np.full(2, -4.0), np.full(2, 4.0), obstacle_rows(boxes))
    room = room_for(floor, 0.45)
    assert 500 < np.count_nonzero(room.free) < np.count_nonzero(floor.free)
    for i, j in rng.permutation(np.argwhere(room.free))[:400]:
        place = room.origin_m + room.cell_m * (np.array([j, i]) + rng.uniform(0, 1, 2))
        for box in boxes:
            offset = np.array([box.x_m, box.y_m]) - place
            cos, sin = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
            along = abs(offset @ [cos, sin]) - box.half_x_m
            across = abs(offset @ [-sin, cos]) - box.half_y_m
            assert np.hypot(max(along, 0), max(across, 0)) >= 0.45


def test_lanes_lie_on_the_right_and_lead_from_junction_to_junction():
    for seed in range(5):
        plan = draw_plan(np.random.default_rng(seed))
        lanes = lanes_of(plan.segments)
        assert len(lanes) == 2 * len(plan.segments)
        for lane in lanes:
            street = plan.segments[lane.segment].street
            ahead = lane.end_m - lane.start_m
            right = np.array([ahead[1], -ahead[0]]) / np.linalg.norm(ahead)
            middle = street.point(0.0, 0.0)
            assert (lane.start_m - middle)[1 - street.axis] * right[1 - street.axis] == pytest.approx(LANE_M / 2)
            after = [one for one in lanes if one.from_junction == lane.to_junction and one.segment != lane.segment]
            assert after
            assert all(np.linalg.norm(one.start_m - lane.end_m) < 20.0 for one in after)


@pytest.mark.parametrize(
    ("arguments", "told"), [((-1,), "moving"), ((0, -2), "shifted"), ((1, 0, -1.0), "speed"), ((1, 0, np.nan), "speed")]
)
def test_motion_that_makes_no_sense_is_refused(arguments, told):
    with pytest.raises(UsageError, match=told):
        MotionConfig(*arguments)
