"""Depth and ids of the ray renderer against analytic shapes, brute force and MuJoCo's own rays."""

import mujoco
import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.views import Camera
from sbm_gym.rendering.rays.renderer import RaysRenderer

from .pixels import pixel_grid

SIZE_PX = 64
INTRINSICS = intrinsics_from_fov(SIZE_PX, SIZE_PX, np.deg2rad(70))
TETRAHEDRON = '<mesh name="solid" vertex="0 0 0  .7 0 0  0 .6 0  .1 .1 .8"/>'


def scene(body: str, assets: str = "") -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{assets}</asset><worldbody><light pos='0 0 5'/>{body}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def draw(model, data, camera_to_world, size_px=SIZE_PX, intrinsics=INTRINSICS, **options):
    return RaysRenderer(model).render(data, Camera(intrinsics, camera_to_world, (size_px, size_px)), **options)


def rays(camera_to_world):
    """Origin and, per pixel, the float64 direction whose hit parameter is z-depth."""
    pixels = np.column_stack([pixel_grid(SIZE_PX, SIZE_PX), np.ones(SIZE_PX**2)])
    return camera_to_world[:3, 3], pixels @ np.linalg.inv(INTRINSICS).T @ camera_to_world[:3, :3].T


def interior(geom_id, reach=1):
    """Pixels whose neighbours all show the same geom."""
    padded = np.pad(geom_id, reach, mode="edge")
    same = np.ones(geom_id.shape, bool)
    for dy in range(2 * reach + 1):
        for dx in range(2 * reach + 1):
            same &= padded[dy : dy + geom_id.shape[0], dx : dx + geom_id.shape[1]] == geom_id
    return same


def test_sphere_depth_is_analytic():
    model, data = scene('<geom type="sphere" size=".5" pos=".1 0 1"/>')
    camera = look_at(np.array([-2.0, 0.3, 1.4]), np.array([0.1, 0.0, 1.0]))
    frame = draw(model, data, camera)
    origin, directions = rays(camera)
    offset = origin - [0.1, 0.0, 1.0]
    a, b, c = (directions**2).sum(1), directions @ offset, offset @ offset - 0.25
    inside = b * b - a * c
    expected = ((-b - np.sqrt(np.maximum(inside, 0.0))) / a).reshape(SIZE_PX, SIZE_PX)
    core = interior(frame.geom_id) & (frame.geom_id == 0)
    assert core.sum() > 200
    assert np.abs(frame.depth_m - expected)[core].max() < 1.5e-3
    assert np.median(np.abs(frame.depth_m - expected)[core]) < 2e-4
    assert np.mean((frame.geom_id == 0) == (inside.reshape(SIZE_PX, SIZE_PX) > 0)) > 0.995


@pytest.mark.parametrize("size", ["0 0 1", "3 2 1"])
def test_plane_depth_is_analytic_and_its_edge_exact(size):
    model, data = scene(f'<geom type="plane" size="{size}" pos="0 0 .2" euler="5 -8 20"/>')
    camera = look_at(np.array([0.5, -4.0, 1.6]), np.array([0.0, 0.0, 0.2]))
    frame = draw(model, data, camera)
    origin, directions = rays(camera)
    rotation = data.geom_xmat[0].reshape(3, 3)
    hit = ((data.geom_xpos[0] - origin) @ rotation[:, 2]) / (directions @ rotation[:, 2])
    local = (origin + hit[:, None] * directions - data.geom_xpos[0]) @ rotation
    half = np.array([float(s) or np.inf for s in size.split()[:2]])
    covered = (hit > 0) & (np.abs(local[:, :2]) <= half).all(axis=1)
    assert np.array_equal(frame.geom_id.ravel() == 0, covered)
    near = covered & (hit < 100.0)  # at the horizon the float32 rays themselves decide
    np.testing.assert_allclose(frame.depth_m.ravel()[near], hit[near], rtol=1e-5)
    assert (frame.depth_m.ravel()[~covered] == 0).all()


def test_plane_is_not_drawn_from_behind():
    model, data = scene('<geom type="plane" size="2 2 1" pos="0 0 3"/>')
    frame = draw(model, data, look_at(np.array([0.1, 0.0, 1.0]), np.array([0.3, 0.0, 3.0])))
    assert (frame.geom_id == -1).all()


def test_box_hits_match_the_slab_test():
    model, data = scene('<geom type="box" size=".5 .3 .4" pos="0 .2 1" euler="10 20 30"/>')
    camera = look_at(np.array([-2.0, -0.5, 1.9]), np.array([0.0, 0.2, 1.0]))
    frame = draw(model, data, camera)
    origin, directions = rays(camera)
    rotation = data.geom_xmat[0].reshape(3, 3)
    start, along = (origin - data.geom_xpos[0]) @ rotation, directions @ rotation
    near, far = (-np.sign(along) * [0.5, 0.3, 0.4] - start) / along, (np.sign(along) * [0.5, 0.3, 0.4] - start) / along
    entry, leave = near.max(axis=1), far.min(axis=1)
    covered = entry < leave
    assert np.count_nonzero(covered != (frame.geom_id.ravel() == 0)) <= 1
    both = covered & (frame.geom_id.ravel() == 0)
    assert both.sum() > 200
    np.testing.assert_allclose(frame.depth_m.ravel()[both], entry[both], atol=1e-5)


def test_mesh_depth_matches_brute_force_triangles():
    model, data = scene('<geom type="mesh" mesh="solid" pos="0 0 .5" euler="0 0 40"/>', TETRAHEDRON)
    camera = look_at(np.array([-0.9, -0.6, 1.2]), np.array([0.1, 0.2, 0.8]))
    frame = draw(model, data, camera)
    origin, directions = rays(camera)
    corners = model.mesh_vert[model.mesh_face] @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    nearest = np.full(len(directions), np.inf)
    for a, b, c in corners:  # Moeller and Trumbore, 1997
        p = np.cross(directions, c - a)
        det = p @ (b - a)
        u = p @ (origin - a) / det
        q = np.cross(origin - a, b - a)
        v, t = directions @ q / det, (c - a) @ q / det
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        nearest[hit] = np.minimum(nearest[hit], t[hit])
    # MuJoCo keeps mesh vertices in the inertia frame: in the world they stand where the file put them.
    assert np.abs(corners.reshape(-1, 3).min(axis=0)[2] - 0.5) < 1e-6
    hit = np.isfinite(nearest)
    assert np.count_nonzero(hit != (frame.geom_id.ravel() == 0)) <= 1
    both = hit & (frame.geom_id.ravel() == 0)
    assert both.sum() > 200
    np.testing.assert_allclose(frame.depth_m.ravel()[both], nearest[both], atol=1e-5)


ALL_SHAPES = """
<geom type="plane" size="0 0 1"/>
<geom type="sphere" size=".3" pos="-1.2 0 .5"/>
<geom type="box" size=".3 .2 .4" pos="-.4 0 .5" euler="0 0 30"/>
<geom type="cylinder" size=".2 .3" pos=".4 0 .5" euler="20 0 0"/>
<geom type="capsule" size=".2 .3" pos="1.1 0 .5" euler="0 30 0"/>
<geom type="ellipsoid" size=".2 .3 .4" pos="1.8 0 .5"/>
<geom type="mesh" mesh="solid" pos="-1.8 -.3 .2" euler="0 20 10"/>
<geom type="plane" size=".5 .4 1" pos=".8 1 1.4" euler="70 10 0"/>
<body pos="-.5 1 1.3" euler="10 20 30"><freejoint/><geom type="box" size=".3 .2 .1"/></body>
"""


@pytest.mark.parametrize("eye", [(0.3, -3.0, 1.9), (-3.0, -1.5, 1.2), (2.5, -2.5, 3.0)])
def test_every_shape_agrees_with_mujocos_own_rays(eye):
    model, data = scene(ALL_SHAPES, TETRAHEDRON)
    camera = look_at(np.array(eye), np.array([0.0, 0.2, 0.6]))
    frame = draw(model, data, camera)
    origin, directions = rays(camera)
    expected_id = np.full((1, 1), -1, np.int32)
    expected, ids = np.zeros(len(directions)), np.zeros(len(directions), np.int32)
    for index, direction in enumerate(directions):
        distance = mujoco.mj_ray(model, data, origin, direction / np.linalg.norm(direction), None, 1, -1, expected_id)
        ids[index] = expected_id[0, 0]
        expected[index] = distance / np.linalg.norm(direction) if distance >= 0 else 0.0
    ids, expected = ids.reshape(SIZE_PX, SIZE_PX), expected.reshape(SIZE_PX, SIZE_PX)
    core = interior(ids)
    assert (frame.geom_id == ids)[core].all()
    assert np.mean(frame.geom_id == ids) > 0.99
    near = core & (ids >= 0) & (expected < 10.0)
    error = np.abs(frame.depth_m - expected)[near]
    assert np.median(error) < 1e-5
    assert np.quantile(error, 0.99) < 1e-3
    assert len(np.unique(ids)) >= 8


def test_height_field_agrees_with_mujocos_own_rays():
    asset = '<hfield name="h" nrow="9" ncol="12" size="1.5 1 .5 .2"/>'
    model, data = scene('<geom type="hfield" hfield="h" pos="0 0 .3"/>', asset)
    model.hfield_data[:] = np.random.default_rng(3).random(model.nhfielddata)
    camera = look_at(np.array([-2.0, -2.2, 2.2]), np.array([0.0, 0.0, 0.4]))
    frame = draw(model, data, camera)
    origin, directions = rays(camera)
    found = np.full((1, 1), -1, np.int32)
    distance = [mujoco.mj_ray(model, data, origin, d / np.linalg.norm(d), None, 1, -1, found) for d in directions]
    expected = (np.array(distance) / np.linalg.norm(directions, axis=1)).reshape(SIZE_PX, SIZE_PX)
    assert np.mean((expected > 0) == (frame.geom_id == 0)) > 0.995
    both = (expected > 0) & (frame.geom_id == 0)
    assert both.sum() > 500
    assert np.quantile(np.abs(frame.depth_m - expected)[both], 0.98) < 1e-3


def test_hidden_groups_and_wholly_transparent_geoms_are_not_drawn():
    shapes = "".join(
        f'<geom type="box" size=".1 .1 .1" pos="1 {0.5 * group - 1} 1" group="{group}"/>' for group in range(5)
    )
    model, data = scene(shapes + '<geom type="sphere" size=".2" pos="1 0 1.5" rgba="1 0 0 0"/>')
    frame = draw(model, data, look_at(np.array([-1.0, 0.0, 1.2]), np.array([1.0, 0.0, 1.2])))
    assert set(np.unique(frame.geom_id)) == {-1, 0, 1, 2}


def test_depth_and_id_report_what_stands_behind_glass_and_colour_blends():
    wall = '<geom type="box" size=".1 2 2" pos="3 0 1" rgba="0 0 1 1"/>'
    glass = '<geom type="box" size=".01 2 .5" pos="2 0 1.5" rgba="1 0 0 .5"/>'
    camera = look_at(np.array([0.0, 0.0, 1.0]), np.array([3.0, 0.0, 1.0]))
    model, data = scene(wall + glass)
    frame = draw(model, data, camera, antialias=False)
    assert (frame.geom_id[20:44, 20:44] == 0).all()
    np.testing.assert_allclose(frame.depth_m[20:44, 20:44], 2.9, atol=1e-4)
    through, beside = frame.rgb[20, 32].astype(int), frame.rgb[50, 32].astype(int)
    assert through[0] > beside[0] + 50
    assert through[2] < beside[2] - 20


def holes_scene():
    picture = np.zeros((16, 16, 4), np.uint8)
    picture[..., :3] = 200
    picture[:, 8:, 3] = 255
    spec = mujoco.MjSpec()
    texture = spec.add_texture(name="leaf", type=mujoco.mjtTexture.mjTEXTURE_2D)
    texture.width, texture.height, texture.nchannel, texture.data = 16, 16, 4, picture.tobytes()
    material = spec.add_material(name="leaf")
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "leaf"
    world = spec.worldbody
    box = mujoco.mjtGeom.mjGEOM_BOX
    world.add_geom(type=box, size=[3, 3, 0.1], pos=[0, 0, -0.1])
    world.add_geom(type=box, size=[0.5, 0.5, 0.01], pos=[0, 0, 1], material="leaf")
    world.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=[0, 0, -1], diffuse=[0.5] * 3)
    spec.visual.headlight.active = 0
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_rays_pass_through_holes_of_textures_and_so_does_light():
    model, data = holes_scene()
    camera = look_at(np.array([0.0, -0.01, 3.0]), np.array([0.0, 0.0, 0.0]))
    renderer = RaysRenderer(model)
    frame = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    row = frame.geom_id[SIZE_PX // 2]
    leaf = np.flatnonzero(row == 1)
    assert len(leaf) > 4
    assert leaf.min() >= SIZE_PX // 2 - 1
    assert np.array_equal(
        renderer.amodal_mask(data, [1], Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX))), frame.geom_id == 1
    )
    low = look_at(np.array([0.0, -2.5, 0.8]), np.array([0.0, 0.0, 0.0]))
    floor = renderer.render(data, Camera(INTRINSICS, low, (SIZE_PX, SIZE_PX)), antialias=False)
    origin, directions = rays(low)
    ground = origin + floor.depth_m.reshape(-1, 1) * directions
    brightness = floor.rgb.mean(axis=2).ravel()
    on_floor = (floor.geom_id.ravel() == 0) & (np.abs(ground[:, 1]) < 0.4)
    dark = brightness[on_floor & (ground[:, 0] > 0.1) & (ground[:, 0] < 0.4)]
    light = brightness[on_floor & (ground[:, 0] < -0.1) & (ground[:, 0] > -0.4)]
    assert dark.max() < 0.8 * light.min()


def test_moving_bodies_are_followed():
    model, data = scene(
        '<geom type="box" size=".1 3 3" pos="4 0 1"/>'
        '<body name="m" mocap="true" pos="2 0 1"><geom type="box" size=".2 .2 .2"/></body>'
        '<body pos="2 0 2"><freejoint/><geom type="sphere" size=".2"/></body>'
    )
    renderer = RaysRenderer(model)
    camera = look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    before = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    data.mocap_pos[0] = [2, 0.8, 1]
    data.qpos[:3] = [2, -0.8, 1]
    mujoco.mj_kinematics(model, data)
    after = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    fresh = draw(model, data, camera)
    assert before.geom_id[32, 32] == 1
    assert after.geom_id[32, 32] == 0
    assert np.mean(np.argwhere(after.geom_id == 1)[:, 1]) < 28  # +Y is left
    assert np.mean(np.argwhere(after.geom_id == 2)[:, 1]) > 36
    for left, right in zip(
        (after.rgb, after.depth_m, after.geom_id), (fresh.rgb, fresh.depth_m, fresh.geom_id), strict=True
    ):
        assert np.array_equal(left, right)


def test_edits_of_static_geometry_are_followed():
    model, data = scene('<body name="b" pos="2 0 1"><geom type="box" size=".2 .2 .2"/></body>')
    renderer = RaysRenderer(model)
    camera = look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    assert renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX))).geom_id[32, 32] == 0
    model.body("b").pos = [2, 1.5, 1]
    mujoco.mj_kinematics(model, data)
    assert renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX))).geom_id[32, 32] == -1


def test_antialiasing_changes_colour_only():
    model, data = scene(ALL_SHAPES, TETRAHEDRON)
    camera = look_at(np.array([0.3, -3.0, 1.9]), np.array([0.0, 0.2, 0.6]))
    smooth, plain = draw(model, data, camera, antialias=True), draw(model, data, camera, antialias=False)
    assert np.array_equal(smooth.depth_m, plain.depth_m)
    assert np.array_equal(smooth.geom_id, plain.geom_id)
    changed = (smooth.rgb != plain.rgb).any(axis=2)
    assert 0 < changed.sum() < 0.5 * changed.size
    assert not changed[interior(plain.geom_id, 2) & (plain.geom_id == -1)].any()


@pytest.mark.slow
@pytest.mark.parametrize("geoms", [[1], [2, 3], [6], [5, 1, 4], [7], [0], [8], [2, 8]])
def test_amodal_mask_is_what_the_geoms_alone_would_show(geoms):
    model, data = scene(ALL_SHAPES, TETRAHEDRON)
    renderer = RaysRenderer(model)
    hidden = [geom for geom in range(model.ngeom) if geom not in geoms]
    alone = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset>{TETRAHEDRON}</asset><worldbody>{ALL_SHAPES}</worldbody></mujoco>"
    )
    alone.geom_group[hidden] = 4
    alone_data = mujoco.MjData(alone)
    mujoco.mj_forward(alone, alone_data)
    for eye, target in (((0.3, -3.0, 1.9), (0.0, 0.2, 0.6)), ((-0.6, 0.3, 0.9), (1.0, 0.2, 0.6))):
        camera = look_at(np.array(eye), np.array(target))
        mask = renderer.amodal_mask(data, geoms, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
        assert np.array_equal(mask, draw(alone, alone_data, camera).geom_id >= 0)


def test_amodal_mask_follows_moving_geoms():
    model, data = scene('<body mocap="true" pos="2 0 1"><geom type="box" size=".2 .2 .2"/></body>')
    renderer = RaysRenderer(model)
    camera = look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    before = renderer.amodal_mask(data, [0], Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    data.mocap_pos[0] = [2, 0.5, 1]
    mujoco.mj_kinematics(model, data)
    after = renderer.amodal_mask(data, [0], Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    assert before[32, 32]
    assert not after[32, 32]
    assert after.any()


def test_masks_of_nothing_visible_are_empty():
    model, data = scene('<geom type="box" size=".2 .2 .2" pos="2 0 1"/><geom size=".2" pos="2 0 1" group="3"/>')
    renderer = RaysRenderer(model)
    away = look_at(np.array([0.0, 0.0, 1.0]), np.array([-2.0, 0.0, 1.0]))
    assert not renderer.amodal_mask(data, [0], Camera(INTRINSICS, away, (SIZE_PX, SIZE_PX))).any()
    assert not renderer.amodal_mask(data, [1], Camera(INTRINSICS, away, (SIZE_PX, SIZE_PX))).any()
    assert not renderer.amodal_mask(data, [], Camera(INTRINSICS, away, (SIZE_PX, SIZE_PX))).any()


def test_cameras_that_make_no_sense_are_refused():
    model, data = scene('<geom size=".2"/>')
    renderer = RaysRenderer(model)
    camera = look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    with pytest.raises(ValueError, match="at least one pixel"):
        renderer.render(data, Camera(INTRINSICS, camera, (0, 8)))
    with pytest.raises(ValueError, match="finite"):
        renderer.render(data, Camera(INTRINSICS * np.nan, camera, (8, 8)))
    with pytest.raises(ValueError, match="geom ids"):
        renderer.amodal_mask(data, [7], Camera(INTRINSICS, camera, (8, 8)))


def test_empty_scene_is_all_sky():
    model, data = scene("")
    frame = draw(model, data, look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0])))
    assert (frame.geom_id == -1).all()
    assert (frame.depth_m == 0).all()
    assert frame.rgb.dtype == np.uint8
    assert frame.depth_m.dtype == np.float32
    assert frame.geom_id.dtype == np.int32
