"""Environments in which things move: what is drawn, what the robot can touch, what is recorded."""

import gymnasium as gym
import mujoco
import numpy as np
import pytest

import sbm_gym  # noqa: F401, registers the environments
from labeling.core.geometry import unproject
from labeling.core.views import Camera
from labeling.io.episodes import read_episode, write_episode
from labeling.motion.scene_flow import scene_flow
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.env.recording import episode_of_captures
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION

from ..box_rooms import BoxRooms
from ..rollouts import digest

ENVS = {"IndoorBuiltin-v0": "seed/3", "OutdoorBuiltin-v0": "town/seed/1"}
TURN = np.array([0.3, 0.1, 0.2, 0.0], np.float32)


def make(name, **settings) -> FixationEnv:
    env = gym.make(f"sbm_gym/{name}", **settings).unwrapped
    assert isinstance(env, FixationEnv)
    return env


@pytest.fixture(scope="module", params=list(ENVS))
def env(request):
    with make(request.param, moving=4) as made:
        yield made


def started(env, seed=1):
    name = env._source.scenes("train")[0] if env.spec is None else ENVS[env.spec.id.partition("/")[2]]
    env.reset(seed=seed, options={"scene": name})
    return env


@pytest.mark.slow
def test_a_moved_scene_is_drawn_as_if_everything_had_always_stood_there(env):
    started(env)
    for _ in range(6):
        env.step(TURN)
    scene = env.scene
    camera = Camera.from_fov(scene.body.camera_to_world, (96, 96), 0.5 * np.pi)
    seen = scene.renderer.render(scene.data, camera, antialias=False)
    # The same poses written into the model, which nobody has drawn yet.
    model = env._cache._open(env._source, scene.name, "rays", env._config.robot.body).whole_model()
    scene.arrangement.apply(model)
    for instance in scene.world.objects:
        body = model.body(instance.body_name).id
        if model.body_mocapid[body] >= 0:
            mocap = scene.model.body_mocapid[scene.model.body(instance.body_name).id]
            model.body_pos[body], model.body_quat[body] = scene.data.mocap_pos[mocap], scene.data.mocap_quat[mocap]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    fresh = RaysRenderer(model).render(data, camera, antialias=False)
    # Poses differ in their last digits, so rays that graze an edge may hit either side of it.
    assert np.mean(seen.geom_id == fresh.geom_id) > 0.999
    same = seen.geom_id == fresh.geom_id
    assert np.allclose(seen.depth_m[same], fresh.depth_m[same], rtol=1e-4)
    assert np.quantile(np.abs(seen.rgb.astype(int) - fresh.rgb.astype(int)), 0.998) <= 1


SHADOWED = """<mujoco><visual><headlight active="0" ambient=".2 .2 .2"/></visual><worldbody>
<light pos="0 0 2.2" dir="0 0 -1" castshadow="true" cutoff="180" exponent="0"/>
<geom type="box" size="3 3 .05" pos="0 0 -.05"/>
<geom type="box" size="3 .05 1" pos="0 3 1"/>
<body name="one" {moves} pos="{x} {y} .5"><geom type="box" size=".3 .2 .5" rgba=".8 .2 .2 1"/></body>
</worldbody></mujoco>"""


def test_shadows_follow_what_moves():
    def drawn(moves, first, then):
        model = mujoco.MjModel.from_xml_string(SHADOWED.format(moves=moves, x=first[0], y=first[1]))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        renderer = RaysRenderer(model)
        pose = np.array([[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 2.5], [0, 0, 0, 1.0]])
        camera = Camera.from_fov(pose, (120, 120), 0.5 * np.pi)
        renderer.render(data, camera)
        if moves:
            data.mocap_pos[0, :2] = then
            mujoco.mj_forward(model, data)
        return renderer.render(data, camera)

    moved = drawn('mocap="true"', (-0.8, 0.0), (0.9, 0.6))
    fixed = drawn("", (0.9, 0.6), None)
    elsewhere = drawn("", (-0.8, 0.0), None)
    assert np.array_equal(moved.depth_m, fixed.depth_m)
    assert np.array_equal(moved.geom_id, fixed.geom_id)
    apart = np.abs(moved.rgb.astype(int) - fixed.rgb.astype(int))
    assert np.quantile(apart, 0.99) <= 10  # light that has bounced knows what stands still only
    # The floor beside it is in shadow, and where the shadow was it is not.
    on_floor = (moved.geom_id == 0) & (elsewhere.geom_id == 0)
    changed = np.abs(moved.rgb.astype(int) - elsewhere.rgb.astype(int)).max(axis=2) > 15
    assert np.count_nonzero(on_floor & changed) > 100
    expected = np.abs(fixed.rgb.astype(int) - elsewhere.rgb.astype(int)).max(axis=2) > 15
    apart_px = np.count_nonzero(on_floor & (changed != expected))
    assert apart_px <= 0.1 * np.count_nonzero(on_floor & expected)


@pytest.mark.slow
def test_what_does_not_move_is_as_in_environments_that_know_nothing_of_it():
    def told(**settings) -> str:
        with make("OutdoorBuiltin-v0", **settings) as env:
            seen = [env.reset(seed=4, options={"scene": "town/seed/1"})]
            seen += [env.step(TURN) for _ in range(3)]
            assert env.capture(64, 192).moving == ()
            found = digest([*seen, env.capture(64, 192)])
        return found

    assert told() == told(moving=0, shifted=0, moving_speed=2.0)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_episode(env):
    def told():
        started(env, seed=2)
        return digest([*(env.step(TURN) for _ in range(4)), env.capture(48, 48)])

    assert told() == told()


@pytest.mark.slow
def test_ground_truth_boxes_surfaces_and_poses_follow_what_moves(env):
    started(env)
    before = {one.instance_id: one.object_to_world for one in env.capture(32, 32).moving}
    boxes = {one.instance_id: one.box_3d for one in env.scene.world.objects}
    for _ in range(8):
        env.step(TURN)
    now = {one.instance_id: one.object_to_world for one in env.capture(32, 32).moving}
    assert len(now) >= 2
    assert max(np.linalg.norm(now[k][:3, 3] - before[k][:3, 3]) for k in now) > 0.3
    surfaces = dict(zip([o.instance_id for o in env.scene.surfaces.objects], env.scene.surfaces.points_m, strict=True))
    for instance in env.scene.world.objects:
        box = instance.box_3d
        if instance.instance_id not in now:
            assert np.array_equal(box.centre_m, boxes[instance.instance_id].centre_m)
            continue
        assert np.allclose(box.centre_m[:2], now[instance.instance_id][:2, 3])
        inside = (surfaces[instance.instance_id] - box.centre_m) @ box.rotation
        assert np.abs(inside / (0.5 * box.extent_m)).max() < 1.05
        geoms = env.scene.geoms_of_instance[instance.instance_id]
        assert np.allclose(env.scene.data.geom_xpos[geoms].mean(axis=0)[:2], box.centre_m[:2], atol=box.extent_m.max())


@pytest.mark.slow
def test_the_robot_and_what_moves_never_touch(env):
    started(env, seed=3)
    rng = np.random.default_rng(0)
    torso = env.scene.model.geom("agent_torso").id
    nearest, touched = np.inf, False
    for _ in range(25):
        # Straight towards the nearest of them.
        boxes = env.simulation._traffic.boxes()
        here, yaw = env.scene.body.position_m, env.scene.body.yaw_rad
        box = min(boxes, key=lambda one: np.hypot(one.x_m - here[0], one.y_m - here[1]))
        angle = np.arctan2(box.y_m - here[1], box.x_m - here[0]) - yaw + rng.normal(0, 0.2)
        *_, info = env.step(np.array([np.cos(angle), np.sin(angle), 0, 0], np.float32))
        model, data = env.scene.model, env.scene.data
        bodies = [model.body(one.body_name).id for one in env.scene.arrangement.movers]
        for geom in np.flatnonzero(np.isin(model.geom_bodyid, bodies) & (model.geom_group == GEOM_GROUP_COLLISION)):
            nearest = min(nearest, mujoco.mj_geomDistance(model, data, torso, geom, 5.0, None))
        touched |= info["collided"]
    assert -1e-3 < nearest < 2.0


@pytest.mark.slow
def test_flow_is_that_of_the_simulators_geoms(env, tmp_path):
    """Where a point of a geom went, MuJoCo's own poses of the geom at both times say."""
    for seed in range(1, 12):
        started(env, seed=seed)
        captures, states = [], []
        for _ in range(3):
            env.step(np.zeros(4, np.float32))
            here, box = env.scene.body.position_m, env.simulation._traffic.boxes()[0]
            env.scene.body.look(np.arctan2(box.y_m - here[1], box.x_m - here[0]), -0.2)
            captures.append(env.capture(96, 96))
            states.append((env.scene.data.geom_xpos.copy(), env.scene.data.geom_xmat.copy()))
        moving = {one.instance_id for one in captures[0].moving}
        shown = [one for one in captures[0].ground_truth if one.instance_id in moving and one.modal.sum() > 30]
        if shown:
            break
    else:
        pytest.fail("no moving thing in sight")
    episode = episode_of_captures(captures, env.categories, {}, "one")
    write_episode(tmp_path / "one", episode)
    read = read_episode(tmp_path / "one")
    assert read.motion is not None
    for one, other in zip(episode.motion or (), read.motion, strict=True):
        assert (one.instance_id, one.category, one.moves) == (other.instance_id, other.category, other.moves)
        assert np.array_equal(one.object_to_world, other.object_to_world)
    flow, known = scene_flow(episode, 0, 2)
    (then_pos, then_mat), (now_pos, now_mat) = states[0], states[2]
    checked = 0
    for mask in shown:
        for y, x in np.argwhere(mask.modal)[::7]:
            if not known[y, x]:
                continue
            pixel, depth_m = np.array([[x, y]], float), np.array([captures[0].depth_m[y, x]], float)
            point = unproject(pixel, depth_m, captures[0].intrinsics, captures[0].camera_to_world)[0]
            geoms = env.scene.geoms_of_instance[mask.instance_id]
            local = [then_mat[g].reshape(3, 3).T @ (point - then_pos[g]) for g in geoms]
            told = [now_mat[g].reshape(3, 3) @ at + now_pos[g] - point for g, at in zip(geoms, local, strict=True)]
            assert np.allclose(flow[y, x], told[0], atol=2e-5)
            assert np.allclose(told, told[0], atol=1e-9)
            checked += 1
    assert checked > 3
    still = np.ones(known.shape, bool)
    for mask in shown:
        still &= ~mask.modal
    others = [one.modal for one in captures[0].ground_truth if one.instance_id in moving]
    assert not flow[still & ~np.any(others, axis=0)].any()


def test_atlases_refuse_scenes_in_which_things_move(tmp_path):
    with pytest.raises(ValueError, match="atlas holds views of scenes in which nothing moves"):
        FixationEnv(BoxRooms(), atlas=tmp_path, moving=1)


def test_worlds_in_which_nothing_can_move_say_so():
    with FixationEnv(BoxRooms(), moving=1) as env, pytest.raises(ValueError, match="nothing can move in scene"):
        env.reset(seed=0)


@pytest.mark.slow
def test_the_robot_cannot_be_put_where_something_is_about_to_move(env):
    started(env)
    mover = env.scene.arrangement.movers[0]
    with pytest.raises(ValueError, match="cannot stand at"):
        env.reset(seed=1, options={"scene": env.scene.name, "start": mover.pose(0.0)[:2]})
