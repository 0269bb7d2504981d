"""Pictures without colours show the same things at the same depths."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.views import Camera
from sbm_gym.rendering.gl.renderer import GlRenderer
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.rendering.tables.scene_tables import GLASS, HOLES, geom_kinds
from sbm_gym.scenes.world_sources import world_source

HEIGHT_PX, WIDTH_PX = 64, 96
INTRINSICS = intrinsics_from_fov(WIDTH_PX, HEIGHT_PX, 0.5 * np.pi)
RENDERERS = [RaysRenderer, GlRenderer]


def assert_same_without_colours(renderer, data, camera):
    """Returns the ids that were seen."""
    view = (data, Camera(INTRINSICS, camera, (HEIGHT_PX, WIDTH_PX)))
    for antialias in (False, True):
        plain = renderer.render(*view, antialias=antialias, colours=False)
        frame = renderer.render(*view, antialias=antialias)
        assert plain.depth_m.dtype == frame.depth_m.dtype
        assert plain.geom_id.dtype == frame.geom_id.dtype
        assert plain.depth_m.tobytes() == frame.depth_m.tobytes()
        assert np.array_equal(plain.geom_id, frame.geom_id)
        assert plain.rgb.shape == frame.rgb.shape
        assert plain.rgb.dtype == np.uint8
        assert not plain.rgb.any()
        assert frame.rgb.any()
    return set(np.unique(plain.geom_id).tolist())


def glass_and_holes() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A floor and a wall; before it two chequered cards, a ball that can be moved, and panes between and before them.

    Geoms: 0 floor, 1 wall, 2 and 3 cards with holes, 4 to 6 glass, 7 ball.
    """
    spec = mujoco.MjSpec()
    picture = np.full((64, 64, 4), 255, np.uint8)
    rows, columns = np.ogrid[:64, :64]
    picture[..., 3] = np.where((rows // 8 + columns // 8) % 2, 255, 0)
    texture = spec.add_texture(name="leaf", type=mujoco.mjtTexture.mjTEXTURE_2D, width=64, height=64, nchannel=4)
    texture.data = picture.tobytes()
    material = spec.add_material(name="leaf")
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGBA] = "leaf"
    mesh = spec.add_mesh(name="card", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    corners = np.array([[0, 1, 0], [0, -1, 0], [0, -1, 2], [0, 1, 2]], np.float32)
    faces = np.array([0, 1, 2, 0, 2, 3], np.int32)
    mesh.uservert, mesh.userface = corners.ravel(), faces
    mesh.usertexcoord = np.array([0, 1, 1, 1, 1, 0, 0, 0], np.float32)
    mesh.userfacetexcoord = faces
    world, kinds = spec.worldbody, mujoco.mjtGeom
    world.add_light(pos=[-1, 0, 3], castshadow=True)
    world.add_geom(type=kinds.mjGEOM_PLANE, size=[9, 9, 0.1], rgba=[0.6, 0.6, 0.5, 1])
    world.add_geom(type=kinds.mjGEOM_BOX, size=[0.1, 3, 1.5], pos=[2, 0, 1.5], rgba=[0.2, 0.2, 0.9, 1])
    for place in ([0, 0.2, 1.2], [1, -0.3, 1.0]):
        world.add_geom(type=kinds.mjGEOM_MESH, meshname="card", material="leaf", pos=place, contype=0, conaffinity=0)
    for x in (-0.6, 0.5, 1.4):
        world.add_geom(type=kinds.mjGEOM_BOX, size=[0.01, 0.8, 0.7], pos=[x, 0, 1], rgba=[0.9, 0.1, 0.1, 0.4])
    body = world.add_body(name="ball", mocap=True, pos=[0.7, 0.5, 0.4])
    body.add_geom(type=kinds.mjGEOM_SPHERE, size=[0.3, 0, 0], rgba=[0.2, 0.7, 0.2, 1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.slow
@pytest.mark.parametrize("make", RENDERERS)
def test_depth_and_ids_behind_glass_and_in_holes_are_the_same_without_colours(make):
    model, data = glass_and_holes()
    renderer, seen = make(model), set()
    for eye in ((-1.5, 0.3, 1.0), (0.25, -0.2, 0.9), (-1.0, -1.2, 2.2), (3.5, 0.1, 4.5)):
        for y in (0.5, -0.4):
            data.mocap_pos[0, 1] = y
            mujoco.mj_forward(model, data)
            camera = look_at(np.array(eye), np.array([0.6, 0.05, 0.8]))
            seen |= assert_same_without_colours(renderer, data, camera)
    assert seen == {-1, 0, 1, 2, 3, 7}
    renderer.close()


@pytest.mark.parametrize("make", RENDERERS)
def test_colours_do_not_depend_on_pictures_without_them(make):
    model, data = glass_and_holes()
    camera = Camera(INTRINSICS, look_at(np.array([-1.5, 0.3, 1.0]), np.array([0.6, 0, 0.8])), (HEIGHT_PX, WIDTH_PX))
    first, second = make(model), make(model)
    second.render(data, camera, colours=False)
    assert np.array_equal(first.render(data, camera).rgb, second.render(data, camera).rgb)
    first.close()
    second.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "scene"),
    [("indoor", "train/12"), pytest.param("outdoor", "town/train/00", marks=pytest.mark.nightly)],
)
def test_furnished_rooms_and_towns_are_the_same_without_colours(kind, scene):
    world = world_source(kind).build(scene)
    model = world.spec.compile()
    world = replace(world, bare=mujoco.MjSpec(), left_out=None)  # needs as much memory as the model
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    navigable = world.navigable
    if world.stage is not None:
        arrangement = world.stage.arrange(rng)
        arrangement.apply(model)
        navigable = arrangement.navigable
        mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    kinds = geom_kinds(model)
    assert (kinds == HOLES).any()
    assert (kinds == GLASS).any()
    holed = data.geom_xpos[kinds == HOLES]
    seen = set()
    rays, gl = RaysRenderer(model), GlRenderer(model)
    for index in range(8):
        eye = np.array([*navigable.random_point(rng), 1.5])
        nearest = holed[np.argsort(np.linalg.norm(holed - eye, axis=1))[:3]]
        camera = look_at(eye, nearest[index % len(nearest)])
        seen |= assert_same_without_colours(rays, data, camera)
        if index == 0:
            assert_same_without_colours(gl, data, camera)
    assert seen & set(np.flatnonzero(kinds == HOLES).tolist())
    gl.close()
