"""Visible and cut-off shares from surface points, against counted pixels."""

import mujoco
import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.views import Camera
from sbm_gym.detection.visibility import surface_points
from sbm_gym.robot.body import BodyConfig
from sbm_gym.scenes.compiled import Scene, compile_scene

from ..box_rooms import BoxRooms

SIZE_PX = 200
INTRINSICS = intrinsics_from_fov(SIZE_PX, SIZE_PX, np.pi / 2)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return compile_scene("box_0", BoxRooms().build("box_0"), "rays", BodyConfig())


def draw(scene, pose, size_px=SIZE_PX, intrinsics=INTRINSICS):
    frame = scene.renderer.render(scene.data, Camera(intrinsics, pose, (size_px, size_px)), antialias=False)
    return scene.instance_of_geom[frame.geom_id]


def observe(scene, pose):
    return scene.surfaces.observe(draw(scene, pose), Camera(INTRINSICS, pose, (SIZE_PX, SIZE_PX)))


def test_points_lie_on_the_surface_of_their_box(scene):
    for instance in scene.world.objects:
        geoms = scene.geoms_of_instance[instance.instance_id]
        points = surface_points(scene.model, scene.data, geoms, 500)
        box = instance.box_3d
        local = np.abs((points - box.centre_m) @ box.rotation) / (box.extent_m / 2)
        assert np.allclose(local.max(axis=1), 1.0, atol=1e-9)
        # All six sides get their share.
        assert np.linalg.norm(points.mean(axis=0) - box.centre_m) < 0.1


def test_visible_share_agrees_with_counted_pixels(scene):
    rng = np.random.default_rng(0)
    compared = 0
    for _ in range(25):
        eye = np.append(scene.world.navigable.random_point(rng), 1.5)
        pose = look_at(eye, np.array([rng.uniform(-2, 2), rng.uniform(-2, 2), 0.5]))
        instance_map = draw(scene, pose)
        observed = {o.instance_id: o for o in observe(scene, pose)}
        for instance in scene.world.objects:
            geoms = scene.geoms_of_instance[instance.instance_id]
            amodal = scene.renderer.amodal_mask(scene.data, geoms, Camera(INTRINSICS, pose, (SIZE_PX, SIZE_PX)))
            if np.count_nonzero(amodal) < 600:
                continue
            share = np.count_nonzero(instance_map == instance.instance_id) / np.count_nonzero(amodal)
            estimate = observed[instance.instance_id].visible_share if instance.instance_id in observed else 0.0
            assert estimate == pytest.approx(share, abs=0.25)
            compared += 1
    assert compared > 30


def test_a_whole_object_is_not_truncated_and_one_half_out_is(scene):
    fridge = scene.world.objects[0]
    whole = look_at(np.array([2.0, 0.5, 1.5]), fridge.box_3d.centre_m)
    (seen,) = [o for o in observe(scene, whole) if o.category == "fridge"]
    assert seen.truncated_share == 0.0
    # Turned away by 45 degrees, the picture's edge runs through the middle.
    turned = whole.copy()
    half_turn = np.deg2rad(45)
    spin = np.array([[np.cos(half_turn), -np.sin(half_turn), 0], [np.sin(half_turn), np.cos(half_turn), 0], [0, 0, 1]])
    turned[:3, :3] = spin @ whole[:3, :3]
    (cut,) = [o for o in observe(scene, turned) if o.category == "fridge"]
    assert 0.25 < cut.truncated_share < 0.75


@pytest.mark.parametrize(
    ("side", "azimuth"), [((0, -1), 0.0), ((1, 0), np.pi / 2), ((-1, 0), -np.pi / 2), ((0, 1), np.pi)]
)
def test_azimuth_is_measured_from_the_front(scene, side, azimuth):
    box = scene.world.objects[0].box_3d
    eye = box.centre_m + box.rotation @ np.array([1.5 * side[0], 1.5 * side[1], 0.7])
    pose = look_at(eye, box.centre_m)
    (seen,) = [o for o in observe(scene, pose) if o.category == "fridge"]
    assert np.cos(seen.azimuth_rad - azimuth) == pytest.approx(1.0, abs=1e-9)
    assert seen.elevation_rad == pytest.approx(np.arctan2(0.7, 1.5))
    assert seen.range_m == pytest.approx(np.hypot(0.7, 1.5))


def test_round_primitives_and_meshes_are_sampled_within_their_bounds():
    spec = mujoco.MjSpec()
    shapes = mujoco.mjtGeom
    for kind in (shapes.mjGEOM_SPHERE, shapes.mjGEOM_CYLINDER, shapes.mjGEOM_CAPSULE, shapes.mjGEOM_ELLIPSOID):
        spec.worldbody.add_geom(type=kind, size=[0.3, 0.2, 0.1], pos=[1, 2, 3])
    spec.add_mesh(name="solid", uservert=[0, 0, 0, 0.7, 0, 0, 0, 0.6, 0, 0.1, 0.1, 0.8])
    spec.worldbody.add_geom(type=shapes.mjGEOM_MESH, meshname="solid", pos=[1, 2, 3])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom in range(model.ngeom):
        points = surface_points(model, data, [geom], 200)
        assert np.all(np.linalg.norm(points - data.geom_xpos[geom], axis=1) <= model.geom_rbound[geom] + 1e-6)
    with pytest.raises(ValueError, match="no visual geoms"):
        surface_points(model, data, [], 10)
