"""Brightness of worlds with many rooms, which lamps are searched for where, shadows that are borrowed, and haze."""

import mujoco
import numpy as np
import pytest

from labeling.geometry import intrinsics_from_fov, look_at
from sbm_gym.rendering import rays as rays_module
from sbm_gym.rendering.gl import GlRenderer
from sbm_gym.rendering.lamp_reach import everywhere
from sbm_gym.rendering.lights import is_in_sight, light_level
from sbm_gym.rendering.rays import RaysRenderer

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
    return RaysRenderer(model).render(data, INTRINSICS, camera, SIZE_PX, SIZE_PX, antialias=antialias)


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


@pytest.mark.parametrize("room", [0, 1, 3])
def test_searching_lamps_only_where_they_shine_changes_no_picture(monkeypatch, room):
    model, data = rooms(5)
    camera = look_at(CAMERA[:3, 3] + [4 * room, 0, 0], np.array([4 * room + 3.5, 0.2, 0.8]))
    renderer = RaysRenderer(model)
    limited = renderer.render(data, INTRINSICS, camera, SIZE_PX, SIZE_PX, antialias=False)
    assert renderer._reach is not None
    reached = renderer._reach[1].reached
    assert reached.shape[0] == 5
    assert 0.1 < reached.mean() < 0.9
    monkeypatch.setattr(rays_module, "lamp_reach", lambda lights, caster, bounds: everywhere(lights))
    full = draw(model, data, camera)
    assert np.array_equal(limited.rgb, full.rgb)


def test_moved_lamps_and_walls_are_searched_anew():
    model, data = rooms(4)
    renderer = RaysRenderer(model)
    renderer.render(data, INTRINSICS, CAMERA, SIZE_PX, SIZE_PX)
    for edit in ("lamp", "wall"):
        if edit == "lamp":
            model.light_pos[0, 0] += 1.0
        else:
            model.geom_pos[4:7, 2] -= 10.0  # the floor swallows the first walls
        mujoco.mj_forward(model, data)
        seen = renderer.render(data, INTRINSICS, CAMERA, SIZE_PX, SIZE_PX, antialias=False)
        assert np.array_equal(seen.rgb, draw(model, data).rgb)


def test_borrowed_shadows_are_those_that_would_have_been_cast(monkeypatch):
    """Where four neighbours agree nothing is cast: hardly a pixel may differ from casting everywhere."""
    model, data = rooms(2)
    borrowed = {smooth: draw(model, data, antialias=smooth).rgb.astype(int) for smooth in (False, True)}

    def cast_all(self, geom, normal, shadow_rays, needs_ray, occluded, picture, around):
        self._cast_shadows(shadow_rays, needs_ray, occluded)

    monkeypatch.setattr(RaysRenderer, "_find_shadows", cast_all)
    for smooth, picture in borrowed.items():
        difference = np.abs(picture - draw(model, data, antialias=smooth).rgb).max(axis=-1)
        assert (difference > 2).mean() < 0.003
        assert (difference > 40).mean() < 0.001


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
        frames = [r(model).render(data, INTRINSICS, camera, SIZE_PX, SIZE_PX) for r in (RaysRenderer, GlRenderer)]
        brightness.append([float(frame.rgb[48, 48].mean()) for frame in frames])
    for dark, hazy, white in np.array(brightness).T:
        assert dark + 20 < hazy < white - 20
    # Behind dense haze only its own colour is left.
    assert abs(brightness[2][0] - brightness[2][1]) < 30
