"""The OpenGL renderer against the ray renderer, shape by shape, and its manners with contexts."""

import os
import subprocess
import sys
import threading

import cv2
import mujoco
import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.views import Camera
from sbm_gym.rendering.gl import context as gl_context
from sbm_gym.rendering.gl.context import NoOpenGlError
from sbm_gym.rendering.gl.renderer import FAR_M, GlRenderer
from sbm_gym.rendering.gl.two_sided_meshes import two_sided_meshes
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.scenes.compiled import make_renderer

HEIGHT_PX, WIDTH_PX = 72, 96
INTRINSICS = intrinsics_from_fov(WIDTH_PX, HEIGHT_PX, np.deg2rad(80))
CAMERA = look_at(np.array([-2.4, -1.1, 1.7]), np.array([0.2, 0.1, 0.3]))
SHAPES = """
<geom type='plane' size='3 3 .1' rgba='.6 .6 .5 1'/>
<geom type='box' size='.4 .3 .35' pos='.1 .2 .35' euler='0 0 30' rgba='.8 .2 .2 1'/>
<geom type='sphere' size='.3' pos='-.9 -.8 .3' rgba='.2 .3 .8 1'/>
<geom type='cylinder' size='.2 .5' pos='1 -.7 .5' rgba='.2 .7 .3 1'/>
<geom type='capsule' size='.15 .4' pos='-.2 1.2 .6' euler='60 0 20' rgba='.8 .7 .2 1'/>
<geom type='ellipsoid' size='.2 .4 .3' pos='1.2 .8 .4' rgba='.6 .2 .7 1'/>
<geom type='mesh' mesh='solid' pos='-.9 .3 0' rgba='.3 .8 .8 1'/>
"""
SOLID = "<mesh name='solid' vertex='0 0 0  .7 0 0  0 .6 0  .1 .1 .8'/>"


def scene(body=SHAPES, light="<light type='point' pos='0 0 2.5' diffuse='.8 .8 .8'/>", assets=SOLID):
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><visual><headlight active='0' ambient='.2 .2 .2'/></visual><asset>{assets}</asset>"
        f"<worldbody>{light}{body}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def both(model, data, intrinsics=INTRINSICS, camera=CAMERA, **options):
    camera = Camera(intrinsics, camera, (HEIGHT_PX, WIDTH_PX))
    return [renderer(model).render(data, camera, **options) for renderer in (GlRenderer, RaysRenderer)]


def interior(geom_id):
    """Pixels whose neighbours all show the same geom."""
    padded = np.pad(geom_id, 1, mode="edge")
    rows, columns = geom_id.shape
    return np.all([padded[dy : dy + rows, dx : dx + columns] == geom_id for dy in range(3) for dx in range(3)], axis=0)


def assert_same(gl, rays, share=0.995):
    inside = interior(rays.geom_id)
    assert inside.mean() > 0.5
    assert np.mean(gl.geom_id[inside] == rays.geom_id[inside]) >= share
    assert np.median(np.abs(gl.depth_m - rays.depth_m)) < 1e-3
    assert np.percentile(np.abs(gl.depth_m - rays.depth_m)[inside], 98) < 5e-3
    assert np.array_equal(gl.depth_m == 0, gl.geom_id < 0)


@pytest.mark.slow
@pytest.mark.parametrize("antialias", [False, True])
def test_every_shape_stands_where_rays_see_it(antialias):
    gl, rays = both(*scene(), antialias=antialias)
    assert set(np.unique(gl.geom_id)) == set(np.unique(rays.geom_id))
    assert_same(gl, rays)


def test_any_pinhole_camera_is_drawn():
    """Principal point far off the centre, pixels that are not square, a rolled camera."""
    intrinsics = np.array([[70.0, 0, 20.0], [0, 95.0, 55.0], [0, 0, 1]])
    roll = np.eye(4)
    roll[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    gl, rays = both(*scene(), intrinsics=intrinsics, camera=CAMERA @ roll)
    assert_same(gl, rays)


def test_sheared_pixels_are_refused():
    with pytest.raises(ValueError, match="sheared"):
        both(*scene(), intrinsics=INTRINSICS + np.array([[0, 0.5, 0], [0, 0, 0], [0, 0, 0]]))


def test_the_back_of_surfaces_is_drawn_and_that_of_planes_is_not():
    inside_a_box, below_the_floor = np.array([0.0, 0.0, 0.5]), np.array([-2.0, 0.0, -1.0])
    model, data = scene("<geom type='box' size='1 1 1' rgba='.7 .7 .7 1'/>")
    gl, rays = both(model, data, camera=look_at(inside_a_box, np.array([0.9, 0.2, 0.3])))
    assert (gl.geom_id == 0).all()
    assert np.abs(gl.depth_m - rays.depth_m).max() < 1e-3
    model, data = scene("<geom type='plane' size='5 5 .1'/><geom type='sphere' size='.4' pos='0 0 1'/>")
    gl, rays = both(model, data, camera=look_at(below_the_floor, np.array([0.0, 0.0, 1.0])))
    assert set(np.unique(gl.geom_id)) == {-1, 1}
    assert_same(gl, rays)


def test_depth_and_ids_report_what_stands_behind_glass_and_colour_shows_the_glass():
    wall = "<geom type='box' size='.05 2 2' pos='1 0 1' rgba='.2 .8 .2 1'/>"
    pane = "<geom type='box' size='.01 2 2' pos='0 0 1' rgba='.9 .1 .1 {}'/>"
    camera = look_at(np.array([-2.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    clear = both(*scene(wall), camera=camera)[0]
    frames = [both(*scene(wall + pane.format(alpha)), camera=camera) for alpha in (0.3, 0.7)]
    for gl, rays in frames:
        assert_same(gl, rays)
        assert np.array_equal(gl.geom_id, clear.geom_id)
        assert np.array_equal(gl.depth_m, clear.depth_m)
    red = [float(frame.rgb[36, 48, 0]) - frame.rgb[36, 48, 1] for frame in (clear, frames[0][0], frames[1][0])]
    assert red[0] < red[1] < red[2]


def holes_scene():
    """A wall, and before it a card whose left half is transparent."""
    spec = mujoco.MjSpec()
    picture = np.full((64, 64, 4), 255, np.uint8)
    picture[:, :32, 3] = 0
    texture = spec.add_texture(name="leaf", type=mujoco.mjtTexture.mjTEXTURE_2D, width=64, height=64, nchannel=4)
    texture.data = picture.tobytes()
    material = spec.add_material(name="leaf")
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGBA] = "leaf"
    corners = np.array([[0, 1, 0], [0, -1, 0], [0, -1, 2], [0, 1, 2]], float)
    mesh = spec.add_mesh(name="card", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    faces = np.array([0, 1, 2, 0, 2, 3], np.int32)
    mesh.uservert, mesh.userface = corners.astype(np.float32).ravel(), faces
    mesh.usertexcoord = np.array([0, 1, 1, 1, 1, 0, 0, 0], np.float32)
    mesh.userfacetexcoord = faces
    spec.worldbody.add_light(pos=[-1, 0, 2])
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 3, 3], pos=[1, 0, 1], rgba=[0.2, 0.2, 0.9, 1])
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname="card", material="leaf", contype=0, conaffinity=0, mass=0
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_holes_in_textures_are_holes():
    model, data = holes_scene()
    camera = look_at(np.array([-2.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    gl, rays = both(model, data, camera=camera)
    assert_same(gl, rays)
    assert set(np.unique(gl.geom_id[30:42, 30:66])) == {0, 1}
    left, right = gl.rgb[36, 36].astype(int), gl.rgb[36, 60].astype(int)
    assert gl.geom_id[36, 36] == 0
    assert left[2] - left[0] > 60  # the blue wall through the hole
    assert abs(right[2] - right[0]) < 30  # the white card
    masks = [
        r(model).amodal_mask(data, [1], Camera(INTRINSICS, camera, (HEIGHT_PX, WIDTH_PX)))
        for r in (GlRenderer, RaysRenderer)
    ]
    assert np.mean(masks[0] == masks[1]) > 0.99


def test_amodal_masks_are_those_of_the_rays():
    model, data = scene()
    gl, rays = GlRenderer(model), RaysRenderer(model)
    view = Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX))
    whole = gl.render(data, view)
    for geoms in ([1], [2, 3], [0], [4, 5, 6]):
        mask = gl.amodal_mask(data, geoms, view)
        assert np.mean(mask == rays.amodal_mask(data, geoms, view)) > 0.99
        assert mask[np.isin(whole.geom_id, geoms)].all()
    assert np.array_equal(gl.render(data, view).geom_id, whole.geom_id)
    with pytest.raises(ValueError, match="geom ids"):
        gl.amodal_mask(data, [99], view)


def test_moving_bodies_are_followed():
    body = "<body name='m' mocap='true' pos='0 0 .5'><geom type='box' size='.3 .3 .3'/></body>"
    model, data = scene(body)
    gl = GlRenderer(model)
    for x in (0.0, 0.7):
        data.mocap_pos[0, 0] = x
        mujoco.mj_forward(model, data)
        frame = gl.render(data, Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX)))
        assert_same(frame, RaysRenderer(model).render(data, Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX))))


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
def test_every_kind_of_light_lights_and_throws_shadows(kind):
    """A ball above a floor: below it the floor is darker than beside it, unless shadows are off."""
    body = "<geom type='box' size='3 3 .05'/><geom type='sphere' size='.4' pos='0 0 1'/>"
    lamp = f"<light type='{kind}' pos='0 0 2.4' dir='0 0 -1' cutoff='80' exponent='0' diffuse='.7 .7 .7'/>"
    model, data = scene(body, lamp)
    camera = look_at(np.array([-2.0, 0.0, 2.2]), np.array([0.3, 0.0, 0.0]))
    brightness = {}
    for shadows in ("off", "high"):
        frame = GlRenderer(model, shadows=shadows).render(data, Camera(INTRINSICS, camera, (HEIGHT_PX, WIDTH_PX)))
        rows, columns = np.nonzero(frame.geom_id == 0)
        rays = (
            np.stack([columns, rows, np.ones(len(rows))], 1)
            @ np.linalg.inv(INTRINSICS).T
            * frame.depth_m[rows, columns, None]
        )
        place = rays @ camera[:3, :3].T + camera[:3, 3]
        far = np.linalg.norm(place[:, :2], axis=1)
        light = frame.rgb[rows, columns].mean(axis=1)
        brightness[shadows] = light[far < 0.25].mean(), light[(far > 0.9) & (far < 1.2)].mean()
    assert brightness["off"][0] > 0.9 * brightness["off"][1]
    assert brightness["high"][0] < 0.8 * brightness["high"][1]


def test_cloth_with_a_front_and_a_back_in_one_place_has_no_speckles():
    """Each pixel of a flat cloth in even light is like those around it."""
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="cloth", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    corners = np.array([[0, -1, 0], [0, 1, 0], [0, 1, 2], [0, -1, 2]], float)
    mesh.uservert = np.concatenate([corners, corners]).ravel().tolist()
    mesh.userface = [0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6]
    kinds = mujoco.mjtGeom
    spec.worldbody.add_geom(type=kinds.mjGEOM_MESH, meshname="cloth", contype=0, conaffinity=0)
    spec.worldbody.add_geom(type=kinds.mjGEOM_BOX, size=[3, 3, 0.1], pos=[0, 0, -1.5])
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_POINT, pos=[2.0, 0.5, 2.4], diffuse=[0.8] * 3, castshadow=True
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert two_sided_meshes(model).tolist() == [True, False]
    middle = data.geom_xpos[0]
    camera = look_at(middle + np.array([3.0, 0.4, 0.3]), middle)
    frame = GlRenderer(model).render(data, Camera(INTRINSICS, camera, (HEIGHT_PX, WIDTH_PX)))
    cloth = cv2.erode((frame.geom_id == 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    red = np.ascontiguousarray(frame.rgb[..., 0])
    assert cloth.sum() > 500
    assert np.abs(red.astype(int) - cv2.medianBlur(red, 5))[cloth].max() <= 6


def test_pictures_are_about_as_bright_as_those_of_rays():
    gl, rays = both(*scene())
    assert abs(float(gl.rgb.mean()) - float(rays.rgb.mean())) < 25.0


def test_empty_scene_shows_the_sky_of_the_rays():
    gl, rays = both(*scene(body="<geom type='sphere' size='.01' pos='-90 0 0'/>"))
    assert (gl.geom_id == -1).all()
    assert (gl.depth_m == 0).all()
    assert np.abs(gl.rgb.astype(int) - rays.rgb).max() <= 12


def test_what_lies_beyond_the_far_plane_is_not_there():
    model, data = scene(f"<geom type='box' size='1 5000 5000' pos='{FAR_M + 50} 0 0'/>")
    frame = GlRenderer(model).render(
        data, Camera(INTRINSICS, look_at(np.zeros(3), np.array([1.0, 0, 0])), (HEIGHT_PX, WIDTH_PX))
    )
    assert (frame.geom_id == -1).all()
    assert (frame.depth_m == 0).all()


def test_supersampling_changes_colour_only():
    model, data = scene()
    gl = GlRenderer(model)
    smooth, plain = (
        gl.render(data, Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX)), antialias=a) for a in (True, False)
    )
    assert np.array_equal(smooth.geom_id, plain.geom_id)
    assert np.array_equal(smooth.depth_m, plain.depth_m)
    assert len(np.unique(smooth.rgb.reshape(-1, 3), axis=0)) > len(np.unique(plain.rgb.reshape(-1, 3), axis=0))


def test_sizes_may_change_from_picture_to_picture():
    model, data = scene()
    gl = GlRenderer(model)
    first = gl.render(data, Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX)))
    large = intrinsics_from_fov(300, 200, np.deg2rad(80))
    assert gl.render(data, Camera(large, CAMERA, (200, 300))).rgb.shape == (200, 300, 3)
    again = gl.render(data, Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX)))
    assert np.array_equal(first.rgb, again.rgb)
    assert np.array_equal(first.depth_m, again.depth_m)


def test_threads_and_renderers_take_turns():
    """OpenGL draws black, silently, where the context is not current."""
    model, data = scene()
    other, _ = scene("<geom type='box' size='1 1 1'/>")
    gl, second = GlRenderer(model), GlRenderer(other)
    view = Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX))
    expected = gl.render(data, view)
    second.render(mujoco.MjData(other), view)
    found = []
    thread = threading.Thread(target=lambda: found.append(gl.render(data, view)))
    thread.start()
    thread.join()
    for frame in (found[0], gl.render(data, view)):
        assert np.array_equal(frame.rgb, expected.rgb)
        assert np.array_equal(frame.geom_id, expected.geom_id)


def test_closing_frees_and_drawing_opens_again():
    model, data = scene()
    settings = (model.vis.quality.offsamples, model.vis.quality.shadowsize, model.vis.global_.offwidth)
    gl = GlRenderer(model)
    gl.close()
    view = Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX))
    first = gl.render(data, view)
    assert (model.vis.quality.offsamples, model.vis.quality.shadowsize, model.vis.global_.offwidth) == settings
    for _ in range(3):
        gl.close()
        assert np.array_equal(gl.render(data, view).rgb, first.rgb)


def test_shadow_quality_is_one_of_three():
    with pytest.raises(ValueError, match="off, low, high"):
        GlRenderer(scene()[0], shadows="ultra")


def draw_with_gl():
    model, data = scene()
    return GlRenderer(model).render(data, Camera(INTRINSICS, CAMERA, (HEIGHT_PX, WIDTH_PX)))


def test_without_opengl_one_error_says_what_to_install(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(gl_context, "_loads", lambda library: False)
    monkeypatch.setattr(gl_context.platform, "system", lambda: "Linux")
    for make in (lambda: make_renderer("gl", scene()[0]), draw_with_gl):
        with pytest.raises(NoOpenGlError, match=r"apt install .*libegl1.*'rays'"):
            make()
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(NoOpenGlError, match="MUJOCO_GL=disable"):
        make_renderer("gl", scene()[0])


def test_a_driver_that_fails_is_reported_the_same_way(monkeypatch):
    class Broken:
        def __init__(self, width, height):
            raise RuntimeError("no display")

    monkeypatch.setattr(gl_context, "_context_class", lambda kind: Broken)
    with pytest.raises(NoOpenGlError, match="no display"):
        draw_with_gl()


@pytest.mark.parametrize(("on_gpu", "expected"), [(True, GlRenderer), (False, RaysRenderer)])
def test_auto_takes_gl_where_a_gpu_is(monkeypatch, on_gpu, expected):
    monkeypatch.setattr(gl_context, "gpu_available", lambda: on_gpu)
    assert isinstance(make_renderer("auto", scene()[0]), expected)


def test_software_drivers_are_no_gpu(monkeypatch):
    context = gl_context.GlContext()
    for name, expected in (("llvmpipe (LLVM 15)", False), ("NVIDIA H200/PCIe/SSE2", True), ("softpipe", False)):
        monkeypatch.setattr(context, "renderer_name", name)
        assert context.on_gpu is expected
    context.free()


@pytest.mark.slow
def test_a_process_that_never_closes_ends_quietly():
    """Contexts outlive the libraries they need unless somebody frees them in time."""
    code = (
        "import mujoco, numpy as np; from sbm_gym.rendering.gl.renderer import GlRenderer\n"
        "from labeling.core.views import Camera\n"
        "model = mujoco.MjModel.from_xml_string(\"<mujoco><worldbody><geom size='.5'/></worldbody></mujoco>\")\n"
        "data = mujoco.MjData(model); mujoco.mj_forward(model, data)\n"
        "camera = np.eye(4); camera[2, 3] = -2\n"
        "gl = GlRenderer(model)\n"
        "print(gl.render(data, Camera(np.diag([16.0, 16, 1]), camera, (16, 16))).depth_m.max() > 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=os.environ, timeout=60)
    assert done.stdout.strip() == "True"
    assert done.stderr == ""
    assert done.returncode == 0
