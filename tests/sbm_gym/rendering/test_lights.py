"""Brightness of worlds with many rooms, which lamps are searched for where, shadows that are borrowed, and haze."""

import cv2
import mujoco
import numpy as np
import pytest

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.views import Camera
from sbm_gym.rendering.gl.renderer import GlRenderer
from sbm_gym.rendering.rays import ray_scene as scene_module
from sbm_gym.rendering.rays.lamp_reach import everywhere
from sbm_gym.rendering.rays.lighting import Shader
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.rendering.tables.light_tables import NOWHERE, WHOLLY
from sbm_gym.rendering.tables.lights import is_in_sight, light_level

SIZE_PX = 96
INTRINSICS = intrinsics_from_fov(SIZE_PX, SIZE_PX, 0.5 * np.pi)


def rooms(count, *, doors=True):
    """Rooms of 4 m in a row along x, each with a lamp and a box, with openings of 1 m between them."""
    parts = [f"<geom type='box' size='{2 * count} 2 .05' pos='{2 * count} 0 -.05'/>"]
    parts += [f"<geom type='box' size='{2 * count} 2 .05' pos='{2 * count} 0 2.55'/>"]
    parts += [f"<geom type='box' size='{2 * count} .05 1.3' pos='{2 * count} {y} 1.25'/>" for y in (-2.05, 2.05)]
    for wall in range(count + 1):
        spans = [(-2.0, -0.5), (0.5, 2.0)] if doors and 0 < wall < count else [(-2.0, 2.0)]
        parts += [
            f"<geom type='box' size='.05 {(b - a) / 2} 1.3' pos='{4 * wall} {(a + b) / 2} 1.25'/>" for a, b in spans
        ]
    for room in range(count):
        x = 4 * room + 2
        parts.append(f"<light type='point' pos='{x} .3 2.3' diffuse='.7 .7 .7' specular='0 0 0' castshadow='true'/>")
        parts.append(f"<geom type='box' size='.3 .3 .4' pos='{x + 0.9} -.9 .4' rgba='.7 .3 .2 1'/>")
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><visual><headlight active='0' ambient='.2 .2 .2'/></visual><worldbody>"
        + "".join(parts)
        + "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


CAMERA = look_at(np.array([0.4, -1.2, 1.6]), np.array([3.5, 0.2, 0.8]))


def draw(model, data, camera=CAMERA, antialias=False):
    return RaysRenderer(model).render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX)), antialias=antialias)


def test_rooms_behind_walls_do_not_darken_the_picture():
    one, many = light_level(*rooms(1)), light_level(*rooms(6, doors=False))
    assert many.exposure == pytest.approx(one.exposure)
    assert many.fill == pytest.approx(one.fill)
    brightness = [float(draw(*rooms(count, doors=False)).rgb.mean()) for count in (1, 6)]
    assert brightness[0] == pytest.approx(brightness[1], abs=1.5)


def test_lamps_in_one_room_add_up():
    model, data = rooms(1)
    before = light_level(model, data)
    twice = rooms(2)[0]
    twice.light_pos[1] = twice.light_pos[0] + [0.8, 0, 0]
    data = mujoco.MjData(twice)
    mujoco.mj_forward(twice, data)
    after = light_level(twice, data)
    assert after.exposure < before.exposure
    assert (after.fill > before.fill).all()


def test_in_sight_means_that_nothing_drawn_stands_between():
    model, data = rooms(2)
    through_the_door, through_the_wall = np.array([6.0, 0.0, 1.0]), np.array([6.0, 1.5, 1.0])
    assert is_in_sight(model, data, np.array([2.0, 0.0, 1.0]), through_the_door)
    assert not is_in_sight(model, data, np.array([2.0, 1.5, 1.0]), through_the_wall)
    model.geom_group[:] = 3
    assert is_in_sight(model, data, np.array([2.0, 1.5, 1.0]), through_the_wall)


def reach_of(model, data):
    """The grid that says how much of each lamp is drawn where."""
    renderer = RaysRenderer(model)
    renderer.render(data, Camera(INTRINSICS, CAMERA, (SIZE_PX, SIZE_PX)))
    return renderer._scene.illumination(data, CAMERA, True).reach


def at(grid, place):
    x, y, z = np.floor((np.array(place) - grid.origin) / grid.cell_m).astype(int)
    return grid.share[:, z, y, x], grid.around[:, z, y, x]


def test_lamps_are_drawn_in_their_own_room_and_fade_beyond_its_door():
    reach = reach_of(*rooms(5))
    assert reach.share.shape[0] == 5
    for lamp in range(5):
        for dx, dy, z in ((0.0, 0.0, 1.0), (-1.2, -1.2, 0.1), (1.2, 1.2, 2.0)):
            assert at(reach, (4 * lamp + 2 + dx, dy, z))[0][lamp] == 1.0
        if lamp < 4:
            beyond = [at(reach, (4 * lamp + 4 + along, 0.0, 0.5))[0][lamp] for along in (0.3, 1.0, 2.0, 3.5)]
            assert beyond[0] > beyond[1] > beyond[2]
            # Far in the next room next to nothing is left, though the lamp can be seen from there.
            assert max(beyond[2:]) < 0.1
        assert all(
            at(reach, (4 * room + 2, -1.5, 1.0))[1][lamp] == NOWHERE for room in range(5) if abs(room - lamp) > 1
        )


def test_codes_of_the_reach_grid_tell_what_is_around_a_cell():
    reach = reach_of(*rooms(3))
    for share, code in zip(reach.share, reach.around, strict=True):
        padded = np.pad(share, 1, mode="edge")
        around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3, 3)).reshape(*share.shape, 27)
        np.testing.assert_array_equal(code == NOWHERE, around.max(axis=-1) == 0.0)
        np.testing.assert_array_equal(code == WHOLLY, around.min(axis=-1) == 1.0)


def test_searching_lamps_only_where_they_shine_changes_nothing_in_one_room(monkeypatch):
    model, data = rooms(2, doors=False)
    # Both lamps shine in the first room.
    model.light_pos[1] = model.light_pos[0] + [-0.8, -0.6, 0.0]
    mujoco.mj_forward(model, data)
    limited = draw(model, data)
    monkeypatch.setattr(scene_module, "lamp_reach", lambda lights, caster, bounds: everywhere(lights))
    assert np.abs(limited.rgb.astype(int) - draw(model, data).rgb).max() <= 1


def test_moved_lamps_and_walls_are_searched_anew():
    model, data = rooms(4)
    renderer = RaysRenderer(model)
    renderer.render(data, Camera(INTRINSICS, CAMERA, (SIZE_PX, SIZE_PX)))
    for edit in ("lamp", "wall"):
        if edit == "lamp":
            model.light_pos[0, 0] += 1.0
        else:
            model.geom_pos[4:7, 2] -= 10.0  # the floor swallows the first walls
        mujoco.mj_forward(model, data)
        seen = renderer.render(data, Camera(INTRINSICS, CAMERA, (SIZE_PX, SIZE_PX)), antialias=False)
        assert np.array_equal(seen.rgb, draw(model, data).rgb)


@pytest.mark.parametrize("smooth", [False, True])
def test_borrowed_light_is_the_light_that_would_have_been_worked_out(monkeypatch, smooth):
    """Where four neighbours agree nothing is worked out: hardly a pixel may differ from doing so everywhere."""
    model, data = rooms(2)
    borrowed = draw(model, data, antialias=smooth).rgb.astype(int)

    def light_every_pixel(self, surfaces, scene, black, related, height_px, width_px):
        self.light_all(surfaces, scene)

    monkeypatch.setattr(Shader, "light_picture", light_every_pixel)
    difference = np.abs(borrowed - draw(model, data, antialias=smooth).rgb).max(axis=-1)
    assert (difference > 2).mean() < 0.004
    assert (difference > 40).mean() < 0.001


def test_edges_of_shadows_are_softened_and_nothing_else_of_a_surface_changes():
    """Away from them light is the same; across them it falls in steps instead of one."""
    model, data = rooms(1)
    hard, soft = (draw(model, data, antialias=smooth) for smooth in (False, True))
    floor = hard.geom_id == 0
    inside = cv2.erode(floor.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rgb = hard.rgb.astype(int)[..., 0]
    highest, lowest = (f(rgb.astype(np.uint8), np.ones((3, 3), np.uint8)) for f in (cv2.dilate, cv2.erode))
    flat = inside & (highest.astype(int) - lowest <= 3)
    on_edge = inside & (highest.astype(int) - lowest > 12)
    change = np.abs(soft.rgb.astype(int) - hard.rgb).max(axis=-1)
    assert flat.sum() > 300
    assert on_edge.sum() > 40
    assert change[flat].max() <= 3
    steps = [
        np.abs(np.diff(picture.rgb[..., 0].astype(int), axis=0))[inside[1:] & inside[:-1]] for picture in (hard, soft)
    ]
    assert steps[1].max() < 0.8 * steps[0].max()


@pytest.mark.slow
def test_haze_hides_what_is_far_in_both_renderers():
    spec = mujoco.MjSpec()
    sky = [0.2, 0.4, 0.8, 0.7, 0.8, 0.9, 0.3, 0.3, 0.3]
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 60, 60], pos=[40, 0, 0], rgba=[0.1, 0.1, 0.1, 1])
    spec.worldbody.add_light(type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=[1, 0, -1])
    brightness = []
    for haze in (0.0, 0.008, 0.5):
        for numeric in list(spec.numerics):
            spec.delete(numeric)
        spec.add_numeric(name="sky", size=10, data=[*sky, haze])
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        camera = look_at(np.zeros(3), np.array([1.0, 0, 0]))
        frames = [
            r(model).render(data, Camera(INTRINSICS, camera, (SIZE_PX, SIZE_PX))) for r in (RaysRenderer, GlRenderer)
        ]
        brightness.append([float(frame.rgb[48, 48].mean()) for frame in frames])
    for dark, hazy, white in np.array(brightness).T:
        assert dark + 20 < hazy < white - 20
    # Behind dense haze only its own colour is left.
    assert abs(brightness[2][0] - brightness[2][1]) < 30
