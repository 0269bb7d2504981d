"""The body moves as commanded where it can, and stops or slides where it cannot."""

import mujoco
import numpy as np
import pytest

from labeling.geometry import is_rigid, look_at, project
from sbm_gym.agent_body import AGENT_BODY, AgentBody, BodyConfig, add_agent
from sbm_gym.worlds.world import World

from .box_rooms import HALF_ROOM_M, BoxRooms

RADIUS_M = BodyConfig().radius_m


@pytest.fixture(scope="module")
def room() -> tuple[World, AgentBody]:
    world = BoxRooms().build("box_1")
    add_agent(world.spec)
    model = world.spec.compile()
    return world, AgentBody(model, mujoco.MjData(model))


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
        move = body.move(step)
        assert not move.collided
        assert np.allclose(move.displacement_m, step, atol=1e-3)
        assert np.allclose(body.position_m - start, move.displacement_m)
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
            collisions += body.move(0.5 * np.array([np.cos(angle), np.sin(angle)])).collided
            assert body.penetration_m() == 0.0
            assert gap_m(world, body.position_m) > 0.0
            # Nor has it tunnelled: the chord of its way may cut a corner it slid around, never cross a box.
            for share in np.linspace(0, 1, 9):
                assert gap_m(world, before + share * (body.position_m - before)) > -RADIUS_M - 0.05
    assert collisions > 50


def test_a_wall_stops_the_body_and_lets_it_slide_along(room):
    _, body = room
    body.place(np.array([2.6, 0.0]), 0.0, 0.0)
    head_on = body.move(np.array([0.5, 0.0]))
    assert head_on.collided
    assert body.position_m[0] == pytest.approx(HALF_ROOM_M - RADIUS_M - 0.01, abs=0.01)
    oblique = body.move(np.array([0.3, 0.3]))
    assert oblique.collided
    assert oblique.displacement_m[1] == pytest.approx(0.3, abs=0.01)
    assert abs(oblique.displacement_m[0]) < 0.01
    away = body.move(np.array([-0.4, 0.0]))
    assert not away.collided
    assert away.displacement_m[0] == pytest.approx(-0.4, abs=1e-3)


def test_a_body_at_rest_does_not_drift(room):
    _, body = room
    body.place(np.array([2.6, 0.3]), 0.5, -0.1)
    body.move(np.array([0.5, 0.2]))
    resting, yaw, tilt = body.position_m, body.yaw_rad, body.tilt_rad
    for _ in range(50):
        body.move(np.zeros(2))
    assert np.array_equal(body.position_m, resting)
    assert (body.yaw_rad, body.tilt_rad) == (yaw, tilt)


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
    add_agent(spec)
    with pytest.raises(ValueError, match=AGENT_BODY):
        add_agent(spec)
