"""The body moves as commanded where it can, and stops or slides where it cannot."""

from contextlib import nullcontext

import mujoco
import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from labeling.core.geometry import is_rigid, look_at, project
from sbm_gym.robot import body as agent_body
from sbm_gym.robot.body import AGENT_BODY, CONTACT_MARGIN_M, AgentBody, BodyConfig, add_agent
from sbm_gym.scenes.world_sources import world_source
from sbm_gym.worlds.world import World

from ..box_rooms import HALF_ROOM_M, BoxRooms

RADIUS_M = BodyConfig().radius_m


@pytest.fixture(scope="module")
def room() -> tuple[World, AgentBody]:
    world = BoxRooms().build("box_1")
    add_agent(world.spec, BodyConfig())
    model = world.spec.compile()
    return world, AgentBody(model, mujoco.MjData(model), BodyConfig())


def penetration_m(body: AgentBody) -> float:
    """How deep the body is inside an obstacle, 0 if it is in none."""
    contacts = body.data.contact
    ours = np.any(contacts.geom == body.model.geom("agent_torso").id, axis=1)
    return float(max(0.0, -np.min(contacts.dist[ours], initial=0.0)))


def gap_m(world: World, position_m: np.ndarray) -> float:
    """Distance from the body's surface to the nearest wall or box, computed from the boxes themselves."""
    gaps = [HALF_ROOM_M - float(np.max(np.abs(position_m)))]
    for instance in world.objects:
        box = instance.box_3d
        local = np.abs((position_m - box.centre_m[:2]) @ box.rotation[:2, :2]) - box.extent_m[:2] / 2
        gaps.append(float(np.linalg.norm(np.maximum(local, 0.0))) if np.any(local > 0) else float(local.max()))
    return min(gaps) - RADIUS_M


def test_strides_in_free_space_arrive_to_within_a_millimetre(room):
    world, body = room
    rng = np.random.default_rng(0)
    tried = 0
    while tried < 30:
        start, angle = world.navigable.random_point(rng), rng.uniform(0, 2 * np.pi)
        step = rng.uniform(0.05, 0.5) * np.array([np.cos(angle), np.sin(angle)])
        if not world.navigable.line_is_free(start, start + step):
            continue
        body.place(start, 0.0, 0.0)
        assert not body.move(step)
        assert np.allclose(body.position_m - start, step, atol=1e-3)
        tried += 1


def test_driving_at_obstacles_from_anywhere_never_ends_inside_one(room):
    world, body = room
    rng = np.random.default_rng(1)
    collisions = 0
    for _ in range(50):
        body.place(world.navigable.random_point(rng), 0.0, 0.0)
        angle = rng.uniform(0, 2 * np.pi)
        for _ in range(8):
            before = body.position_m
            collisions += body.move(0.5 * np.array([np.cos(angle), np.sin(angle)]))
            assert penetration_m(body) == 0.0
            assert gap_m(world, body.position_m) > 0.0
            # Nor has it tunnelled: the chord of its way may cut a corner it slid around, never cross a box.
            for share in np.linspace(0, 1, 9):
                assert gap_m(world, before + share * (body.position_m - before)) > -RADIUS_M - 0.05
    assert collisions > 50


def test_a_wall_stops_the_body_and_lets_it_slide_along(room):
    _, body = room
    body.place(np.array([2.6, 0.0]), 0.0, 0.0)
    assert body.move(np.array([0.5, 0.0]))
    assert body.position_m[0] == pytest.approx(HALF_ROOM_M - RADIUS_M - 0.01, abs=0.01)
    before = body.position_m
    assert body.move(np.array([0.3, 0.3]))
    assert body.position_m - before == pytest.approx(np.array([0.0, 0.3]), abs=0.01)
    before = body.position_m
    assert not body.move(np.array([-0.4, 0.0]))
    assert (body.position_m - before)[0] == pytest.approx(-0.4, abs=1e-3)


def test_a_body_at_rest_does_not_drift(room):
    _, body = room
    body.place(np.array([2.6, 0.3]), 0.5, -0.1)
    body.move(np.array([0.5, 0.2]))
    resting, yaw, tilt = body.position_m, body.yaw_rad, body.tilt_rad
    for _ in range(50):
        body.move(np.zeros(2))
    assert np.array_equal(body.position_m, resting)
    assert (body.yaw_rad, body.tilt_rad) == (yaw, tilt)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "scene"), [("indoor", "seed/3"), ("outdoor", "town/seed/3")])
def test_being_set_down_where_the_map_is_free_is_what_driving_there_gives(kind, scene):
    source = world_source(kind)
    world, profile = source.build(scene), source.profile
    add_agent(world.spec, profile.body)
    model = world.spec.compile()
    rng = np.random.default_rng(0)
    navigable = world.navigable
    if world.stage is not None:
        arrangement = world.stage.arrange(rng)
        arrangement.apply(model)
        navigable = arrangement.navigable
    driven, set_down = (AgentBody(model, mujoco.MjData(model), profile.body) for _ in range(2))
    tight = np.argwhere(navigable.free & ~np.asarray(binary_erosion(navigable.free), bool))
    tried = stepped = 0
    while tried < 60:
        start, angle = navigable.random_point(rng), rng.uniform(0, 2 * np.pi)
        if tried % 2:
            # The way begins or ends beside an obstacle as often as not.
            start = navigable.origin_m + navigable.cell_m * (rng.choice(tight)[::-1] + rng.uniform(0.1, 0.9, 2))
        move = rng.uniform(0.0, profile.stride_m) * np.array([np.cos(angle), np.sin(angle)])
        if not navigable.line_is_free(start, start + move):
            continue
        tried += 1
        yaw, tilt = rng.uniform(-np.pi, np.pi), rng.uniform(-1.0, 1.0)
        ends = []
        for body, way_is_free in ((driven, False), (set_down, True)):
            body.place(start, yaw, tilt)
            assert not body.move(move, way_is_free=way_is_free)
            ends.append(body.position_m)
            assert penetration_m(body) == 0.0
            assert (body.yaw_rad, body.tilt_rad) == pytest.approx((yaw, tilt))
        stepped += set_down.data.time > 0.0
        assert np.allclose(*ends, atol=1e-3)
        assert np.allclose(driven.camera_to_world, set_down.camera_to_world, atol=1e-3)
        assert np.array_equal(driven.camera_to_world[:3, :3], set_down.camera_to_world[:3, :3])
    # Hardly any goal is so close to something that physics has to tell.
    assert stepped < 0.2 * tried


def test_a_wrong_promise_of_a_free_goal_changes_nothing(room):
    """Into a wall, into the fridge, and to within the margin of a wall."""
    _, body = room
    beside_wall = HALF_ROOM_M - RADIUS_M - 0.5 * CONTACT_MARGIN_M
    for start, goal in (((2.6, 0.0), (3.1, 0.2)), ((0.9, 0.1), (0.4, 0.1)), ((2.6, 0.0), (beside_wall, 0.0))):
        ends: list[tuple[bool, np.ndarray]] = []
        for way_is_free in (False, True):
            body.place(np.array(start), 0.7, -0.2)
            collided = body.move(np.subtract(goal, start), way_is_free=way_is_free)
            assert penetration_m(body) == 0.0
            ends.append((collided, body.camera_to_world))
        assert ends[0][0] == ends[1][0]
        assert np.array_equal(ends[0][1], ends[1][1])
    assert not ends[1][0]


def test_obstacles_out_of_reach_change_no_move_and_stay_solid(room, monkeypatch):
    world, body = room
    before = body.model.body_contype.copy(), body.model.body_conaffinity.copy()
    ends = []
    for slack_m in (agent_body._SLACK_M, 1e3):
        monkeypatch.setattr(agent_body, "_SLACK_M", slack_m)
        rng = np.random.default_rng(2)
        for _ in range(20):
            body.place(world.navigable.random_point(rng), 0.0, 0.0)
            angle = rng.uniform(0, 2 * np.pi)
            for _ in range(4):
                body.move(0.5 * np.array([np.cos(angle), np.sin(angle)]))
                ends.append((*body.position_m, body.data.ncon))
    assert ends[: len(ends) // 2] == ends[len(ends) // 2 :]
    assert max(contacts for *_, contacts in ends) > 0
    assert np.array_equal(before[0], body.model.body_contype)
    assert np.array_equal(before[1], body.model.body_conaffinity)


def test_a_world_that_sleeps_while_the_body_drives_changes_no_move(room, monkeypatch):
    world, body = room
    ends = []
    for near_things_only in (body._near_things_only, lambda reach_m: nullcontext()):
        monkeypatch.setattr(body, "_near_things_only", near_things_only)
        rng = np.random.default_rng(4)
        for _ in range(20):
            body.place(world.navigable.random_point(rng), 0.0, 0.0)
            for _ in range(3):
                collided = body.move(rng.uniform(-0.5, 0.5, 2))
                ends.append((collided, *body.camera_to_world.ravel(), *body.data.qacc_warmstart, body.data.time))
    assert ends[: len(ends) // 2] == ends[len(ends) // 2 :]
    assert any(collided for collided, *_ in ends)
    assert body.model.opt.enableflags == 0


def test_a_body_set_down_drives_on_from_there_at_rest(room):
    _, body = room
    body.place(np.array([2.0, 0.0]), 0.0, 0.0)
    body.move(np.array([0.3, 0.1]), way_is_free=True)
    assert np.allclose(body.position_m, [2.3, 0.1], atol=1e-12)
    before = body.position_m
    body.move(np.zeros(2))
    assert np.array_equal(body.position_m, before)
    assert body.move(np.array([0.6, 0.0]))
    before = body.position_m
    body.move(np.array([-0.4, 0.0]))
    assert (body.position_m - before)[0] == pytest.approx(-0.4, abs=1e-3)


def test_a_turned_head_is_where_a_full_step_of_kinematics_has_it(room):
    _, body = room
    body.place(np.array([1.0, 0.5]), 0.0, 0.0)
    body.look(2.0, -0.3)
    turned = body.camera_to_world
    mujoco.mj_forward(body.model, body.data)
    assert np.array_equal(turned, body.camera_to_world)


def test_moves_are_the_same_every_time(room):
    _, body = room
    ends = []
    for _ in range(2):
        body.place(np.array([1.0, 0.5]), 0.0, 0.0)
        for angle in (0.3, 1.9, 4.0, 2.2):
            body.move(0.5 * np.array([np.cos(angle), np.sin(angle)]))
        ends.append(body.position_m)
    assert np.array_equal(*ends)


@pytest.mark.parametrize(("yaw", "tilt"), [(0.0, 0.0), (1.2, -0.4), (-2.5, 0.6), (3.1, -1.0)])
def test_camera_points_where_pan_and_tilt_say_with_a_level_horizon(room, yaw, tilt):
    _, body = room
    body.place(np.array([0.9, -0.9]), yaw, tilt)
    pose = body.camera_to_world
    forward = np.array([np.cos(tilt) * np.cos(yaw), np.cos(tilt) * np.sin(yaw), np.sin(tilt)])
    assert is_rigid(pose)
    assert np.allclose(pose, look_at(np.array([0.9, -0.9, 1.5]), np.array([0.9, -0.9, 1.5]) + forward))
    pixels, depth = project(pose[None, :3, 3] + 2.0 * forward, np.eye(3), pose)
    assert np.allclose(pixels, 0.0, atol=1e-9)
    assert depth[0] == pytest.approx(2.0)


def test_tilt_is_limited_and_pan_wraps(room):
    _, body = room
    body.look(4.0 * np.pi + 0.5, 3.0)
    assert body.yaw_rad == pytest.approx(0.5)
    assert body.tilt_rad == pytest.approx(BodyConfig().max_tilt_rad)


def test_a_second_agent_is_refused():
    spec = mujoco.MjSpec()
    add_agent(spec, BodyConfig())
    with pytest.raises(ValueError, match=AGENT_BODY):
        add_agent(spec, BodyConfig())
