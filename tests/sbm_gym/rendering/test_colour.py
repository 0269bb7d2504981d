"""Colours of the ray renderer against closed forms: textures, light, shadows, filtering."""

import mujoco
import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.views import Camera
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.rendering.tables.looks import Looks
from sbm_gym.rendering.tables.textures import BYTE_TO_LINEAR, fill_textures, lay_out_textures, srgb_decode, srgb_encode

from .pixels import pixel_grid

SIZE_PX = 64
INTRINSICS = intrinsics_from_fov(SIZE_PX, SIZE_PX, np.deg2rad(60))


def with_texture(picture, build, *, ambient=0.6, kind=mujoco.mjtTexture.mjTEXTURE_2D, repeat=(1.0, 1.0), uniform=False):
    """A world lit by ambient light alone, with one textured material; ``build(spec)`` adds to it."""
    spec = mujoco.MjSpec()
    texture = spec.add_texture(name="picture", type=kind)
    texture.height, texture.width, texture.nchannel = picture.shape
    texture.data = np.ascontiguousarray(picture).tobytes()
    material = spec.add_material(name="matte", specular=0, shininess=0, texrepeat=list(repeat), texuniform=uniform)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "picture"
    spec.visual.headlight.ambient = [ambient] * 3
    spec.visual.headlight.diffuse = [0.0] * 3
    spec.visual.headlight.specular = [0.0] * 3
    build(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def gradient(size=64):
    """Red grows to the right, green downwards: a pixel's colour tells where in the texture it lies."""
    ramp = np.rint((np.arange(size) + 0.5) / size * 255).astype(np.uint8)
    picture = np.full((size, size, 3), 128, np.uint8)
    picture[..., 0], picture[..., 1] = ramp[None, :], ramp[:, None]
    return picture


def add_quad(spec):
    """A 2 m x 2 m wall at x = 2 that faces the origin: texture's left to the viewer's left, top to the top."""
    mesh = spec.add_mesh(name="quad", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = [2, 1, 0, 2, -1, 0, 2, -1, 2, 2, 1, 2]
    mesh.userface = [0, 2, 1, 0, 3, 2]
    mesh.usernormal = [-1, 0, 0] * 4
    mesh.usertexcoord = [0, 1, 1, 1, 1, 0, 0, 0]
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname="quad", material="matte", contype=0, conaffinity=0
    )


def proportions(rgb):
    """Red and green relative to the known blue channel, in linear light: independent of exposure and tone below it."""
    linear = BYTE_TO_LINEAR[rgb].astype(float)
    return linear[..., :2] / linear[..., 2:]


def test_mesh_texture_lies_where_its_uvs_say():
    model, data = with_texture(gradient(), add_quad)
    camera = look_at(np.array([0.0, 0.0, 1.0]), np.array([2.0, 0.0, 1.0]))
    rgb = RaysRenderer(model).render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False).rgb
    pixels = np.column_stack([pixel_grid(SIZE_PX, SIZE_PX), np.ones(SIZE_PX**2)]) @ np.linalg.inv(INTRINSICS).T
    place = pixels[:, :2].reshape(SIZE_PX, SIZE_PX, 2) * 2.0  # metres right of and below the middle of the wall
    u, v = 0.5 + place[..., 0] / 2, 0.5 + place[..., 1] / 2
    inside = (np.minimum(u, v) > 0.1) & (np.maximum(u, v) < 0.75)
    expected = srgb_decode(np.stack([u, v], axis=-1)) / srgb_decode(np.array(128 / 255))
    assert inside.sum() > 500
    np.testing.assert_allclose(proportions(rgb)[inside], expected[inside], rtol=0.12, atol=0.02)


@pytest.mark.parametrize("uniform", [False, True])
def test_plane_and_box_top_wear_the_texture_upright(uniform):
    def build(spec):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 0.1], pos=[0, 0, 0], material="matte")
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], pos=[4, 0, 0.1], material="matte")

    model, data = with_texture(gradient(), build, uniform=uniform)
    renderer = RaysRenderer(model)
    colours = []
    for x in (0.0, 4.0):
        camera = look_at(np.array([x, -0.01, 2.0]), np.array([x, 0.0, 0.0]))
        colours.append(proportions(renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX))).rgb))
        centre = colours[-1][20:44, 20:44]
        assert np.diff(centre[..., 0], axis=1).mean() > 0
        assert np.diff(centre[..., 1], axis=0).mean() > 0
    np.testing.assert_allclose(colours[0][16:48, 16:48], colours[1][16:48, 16:48], rtol=0.1)


def test_cube_texture_faces_look_along_the_axes():
    faces = np.zeros((6, 8, 8, 3), np.uint8)
    faces[...] = np.array([[200, 20, 20], [90, 20, 20], [20, 200, 20], [20, 90, 20], [20, 20, 200], [20, 20, 90]])[
        :, None, None
    ]

    def build(spec):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 1], material="matte")

    model, data = with_texture(faces.reshape(48, 8, 3), build, kind=mujoco.mjtTexture.mjTEXTURE_CUBE)
    renderer = RaysRenderer(model)
    for axis in range(3):
        for sign in (1, -1):
            eye = np.array([0.01, 0.02, 0.03])
            eye[axis] = 3.0 * sign
            rgb = renderer.render(data, Camera(INTRINSICS, look_at(eye, np.zeros(3)), (SIZE_PX, SIZE_PX))).rgb[32, 32]
            expected = faces[2 * axis + (sign < 0), 0, 0].astype(int)
            assert np.argmax(rgb) == np.argmax(expected)
            linear = BYTE_TO_LINEAR[rgb].astype(float)
            assert np.isclose(linear.max() / linear.min(), _linear_ratio(expected), rtol=0.25)


def _linear_ratio(colour):
    return BYTE_TO_LINEAR[colour.max()] / BYTE_TO_LINEAR[colour.min()]


def lit_floor(light, extra=""):
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><visual><headlight ambient=".1 .1 .1" diffuse="0 0 0" specular="0 0 0"/></visual>
        <asset><material name="matte" rgba=".6 .6 .6 1" specular="0"/></asset>
        <worldbody>{light}<geom type="box" size="4 4 .1" pos="0 0 -.1" material="matte"/>{extra}</worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


LAMPS = {
    "point": ('<light type="point" pos="0 0 3" diffuse=".5 .5 .5" specular="0 0 0"/>', np.array([0.0, 0.0, 3.0])),
    "sun": ('<light type="directional" dir="1 0 -1" diffuse=".5 .5 .5" specular="0 0 0"/>', None),
}


@pytest.mark.parametrize("kind", LAMPS)
def test_shadow_lies_where_the_light_cannot_reach(kind):
    light, lamp = LAMPS[kind]
    model, data = lit_floor(light, '<geom type="sphere" size=".4" pos=".2 0 1.2"/>')
    camera = look_at(np.array([0.0, -4.0, 3.0]), np.array([0.5, 0.0, 0.0]))
    frame = RaysRenderer(model).render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False)
    lit = RaysRenderer(model, shadows=False).render(
        data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False
    )
    pixels = np.column_stack([pixel_grid(SIZE_PX, SIZE_PX), np.ones(SIZE_PX**2)])
    directions = pixels @ np.linalg.inv(INTRINSICS).T @ camera[:3, :3].T
    ground = camera[:3, 3] + frame.depth_m.reshape(-1, 1) * directions
    to_light = np.array([-1.0, 0.0, 1.0]) if lamp is None else lamp - ground
    to_light = np.broadcast_to(to_light / np.linalg.norm(to_light, axis=-1, keepdims=True), ground.shape)
    to_ball = np.array([0.2, 0.0, 1.2]) - ground
    along = (to_ball * to_light).sum(axis=1)
    miss = np.linalg.norm(to_ball - along[:, None] * to_light, axis=1)
    floor = frame.geom_id.ravel() == 0
    darker = (frame.rgb.astype(int) < lit.rgb.astype(int) - 15).all(axis=2).ravel()
    assert (floor & (miss < 0.38)).sum() > 30
    assert darker[floor & (miss < 0.38)].all()
    # Between pixels whose light is worked out it is interpolated, here and there by one level otherwise.
    far = floor & (miss > 0.42)
    assert np.abs(frame.rgb.astype(int) - lit.rgb).reshape(-1, 3)[far].max() <= 1


def test_lambert_and_attenuation_follow_their_formulas():
    light = '<light type="point" pos="0 0 2" diffuse="2 2 2" attenuation="1 0 1" specular="0 0 0"/>'
    model, data = lit_floor(light)
    renderer = RaysRenderer(model)
    camera = look_at(np.array([0.0, -3.0, 2.0]), np.array([0.0, 0.0, 0.0]))
    lit = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False)
    model.light_diffuse[:] = 0
    # Ambient light stays what it was, so that the difference is the lamp's own light.
    model.vis.headlight.ambient[:] = 0.1 + 0.25 * 1.5
    dark = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False)
    lamp = BYTE_TO_LINEAR[lit.rgb[..., 0]].astype(float) - BYTE_TO_LINEAR[dark.rgb[..., 0]]
    pixels = np.column_stack([pixel_grid(SIZE_PX, SIZE_PX), np.ones(SIZE_PX**2)])
    directions = pixels @ np.linalg.inv(INTRINSICS).T @ camera[:3, :3].T
    ground = camera[:3, 3] + lit.depth_m.reshape(-1, 1) * directions
    distance = np.linalg.norm(ground - [0, 0, 2], axis=1).reshape(SIZE_PX, SIZE_PX)
    expected = srgb_decode(np.array(0.6)) * 2.0 * (2.0 / distance) / (1.0 + distance**2)
    floor = (lit.geom_id == 0) & (lit.rgb[..., 0] < 200)
    assert floor.sum() > 1000
    np.testing.assert_allclose(lamp[floor], expected[floor], rtol=0.08, atol=0.004)


def test_far_checkerboard_fades_to_its_mean_instead_of_sparkling():
    checks = np.kron(np.indices((32, 32)).sum(axis=0) % 2, np.ones((2, 2)))[..., None] * np.array([255, 255, 255])

    def build(spec):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], material="matte")

    model, data = with_texture(checks.astype(np.uint8), build, repeat=(4.0, 4.0), uniform=True)
    camera = look_at(np.array([0.0, 0.0, 1.5]), np.array([20.0, 3.0, 0.0]))
    rgb = RaysRenderer(model).render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False).rgb
    assert rgb[40:60].std(axis=1).max() < 8


def test_mip_levels_keep_the_mean_light():
    picture = np.random.default_rng(0).integers(0, 256, (64, 32, 3)).astype(np.uint8)
    model, _ = with_texture(picture, add_quad)
    pictures = Looks.of_model(model).pictures
    store = lay_out_textures(pictures)
    fill_textures(pictures, store)
    for level in range(int(store.level_count[0])):
        width, height = store.level_size[0, level]
        start = store.level_start[0, level]
        mean = BYTE_TO_LINEAR[store.texels[start : start + width * height, :3]].mean(axis=0)
        np.testing.assert_allclose(mean, BYTE_TO_LINEAR[picture].mean(axis=(0, 1)), atol=0.01)
    assert tuple(store.level_size[0, int(store.level_count[0]) - 1]) == (1, 1)


def test_srgb_decode_inverts_encode():
    linear = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(srgb_decode(srgb_encode(linear)), linear, atol=1e-9)


def test_antialiased_edges_lie_between_the_colours_they_part():
    model, data = lit_floor("", '<geom type="box" size=".5 .5 .5" pos="0 0 1" euler="0 0 30" rgba="1 0 0 1"/>')
    camera = look_at(np.array([0.2, -3.0, 1.3]), np.array([0.0, 0.0, 1.0]))
    renderer = RaysRenderer(model)
    coarse = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    fine_camera = Camera.from_fov(camera, (8 * SIZE_PX, 8 * SIZE_PX), np.deg2rad(60))
    fine = renderer.render(data, fine_camera, antialias=False)
    plain = renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=False)
    linear = BYTE_TO_LINEAR[fine.rgb].reshape(SIZE_PX, 8, SIZE_PX, 8, 3).mean(axis=(1, 3))
    truth = 255 * srgb_encode(linear)
    error = [np.sqrt(np.mean((picture.rgb - truth) ** 2)) for picture in (coarse, plain)]
    assert error[0] < 0.45 * error[1]


def test_inner_corners_get_less_ambient_light():
    walls = '<geom type="box" size=".1 4 2" pos="2.1 0 1" material="matte"/>'
    walls += '<geom type="box" size="4 .1 2" pos="0 2.1 1" material="matte"/>'
    model, data = lit_floor("", walls)
    camera = look_at(np.array([0.0, 0.0, 1.5]), np.array([2.0, 2.0, 0.0]))
    frame = RaysRenderer(model).render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)))
    floor = frame.geom_id == 0
    pixels = np.column_stack([pixel_grid(SIZE_PX, SIZE_PX), np.ones(SIZE_PX**2)])
    ground = camera[:3, 3] + frame.depth_m.reshape(-1, 1) * (pixels @ np.linalg.inv(INTRINSICS).T @ camera[:3, :3].T)
    to_wall = (2.0 - ground[:, :2].max(axis=1)).reshape(SIZE_PX, SIZE_PX)
    near, open_floor = frame.rgb[floor & (to_wall < 0.1)].mean(), frame.rgb[floor & (to_wall > 0.8)].mean()
    assert near < 0.93 * open_floor
    assert frame.rgb[floor].min() > 20


def test_inverted_normals_shade_like_right_ones():
    def build(spec):
        for name, normal, offset in (("right", -1, 0.0), ("inverted", 1, 3.0)):
            mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
            mesh.uservert = [2, 1, 0, 2, -1, 0, 2, -1, 2, 2, 1, 2]
            mesh.userface = [0, 2, 1, 0, 3, 2]
            mesh.usernormal = [normal, 0, 0] * 4
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, pos=[0, offset, 0], contype=0, conaffinity=0
            )
        spec.visual.headlight.diffuse = [0.5] * 3

    model, data = with_texture(gradient(), build)
    renderer = RaysRenderer(model)
    pictures = []
    for y in (0.0, 3.0):
        centre = data.geom_xpos[0] * [1, 0, 1] + [0, y, 0]
        camera = look_at(centre - [2.0, 0, 0], centre)
        pictures.append(
            renderer.render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX))).rgb[24:40, 24:40].astype(int)
        )
    assert np.abs(pictures[0] - pictures[1]).max() <= 3
    assert pictures[0].min() > 100


def test_skybox_is_the_background_and_stands_upright():
    faces = np.zeros((6, 8, 8, 3), np.uint8)
    faces[2], faces[3] = [0, 0, 255], [0, 255, 0]  # up and down
    faces[[0, 1, 4, 5]] = [255, 0, 0]
    kind = mujoco.mjtTexture.mjTEXTURE_SKYBOX
    model, data = with_texture(faces.reshape(48, 8, 3), lambda spec: None, kind=kind)
    renderer = RaysRenderer(model)
    for target, channel in (((0.1, 0, 5.0), 2), ((0.1, 0, -5.0), 1), ((5.0, 0, 0), 0), ((0, 5.0, 0), 0)):
        camera = look_at(np.zeros(3), np.array(target))
        assert np.argmax(renderer.render(data, Camera(INTRINSICS, camera, (8, 8))).rgb[4, 4]) == channel
