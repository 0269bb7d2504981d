"""Things that move are drawn where they are, wherever they have been in between."""

import mujoco
import numpy as np
import pytest

from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.rendering.rays.ray_scene import STORE_BELOW_M
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.rendering.tables.occupancy import bounds_of
from sbm_gym.rendering.tables.tessellate import twice_areas

SCENE = """<mujoco><worldbody><geom type="plane" size="9 9 1"/><light pos="0 0 4"/>
<body name="a" mocap="true" pos="0 -0.6 0.5"><geom type="sphere" size="0.4"/></body>
<body name="b" mocap="true" pos="0 0.6 0.5"><geom type="box" size="0.3 0.3 0.3"/></body></worldbody></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(SCENE)
CAMERA = look_at(np.array([4.0, 0.0, 1.5]), np.array([0.0, 0.0, 0.4]))


def frame(renderer: RaysRenderer, data: mujoco.MjData):
    mujoco.mj_forward(MODEL, data)
    return renderer.render(data, Camera.from_fov(CAMERA, (48, 64), 1.0))


@pytest.mark.parametrize("away", [STORE_BELOW_M - 5.0, 30.0])
def test_what_went_away_and_came_back_is_drawn_as_before(away: float) -> None:
    data = mujoco.MjData(MODEL)
    renderer = RaysRenderer(MODEL)
    before = frame(renderer, data)
    for moved in ([0], [0, 1]):
        home = data.mocap_pos.copy()
        data.mocap_pos[moved, 2] = away
        without = frame(renderer, data)
        geoms = [1 + one for one in moved]
        assert set(geoms) <= set(np.unique(before.geom_id))
        assert not set(geoms) & set(np.unique(without.geom_id))
        data.mocap_pos[:] = home
        again = frame(renderer, data)
        assert np.array_equal(again.rgb, before.rgb)
        assert np.array_equal(again.depth_m, before.depth_m)


def test_moving_one_thing_gives_the_picture_of_a_new_renderer() -> None:
    data = mujoco.MjData(MODEL)
    renderer = RaysRenderer(MODEL)
    frame(renderer, data)
    data.mocap_pos[1] += [0.5, 0.2, 0.3]
    moved, fresh = frame(renderer, data), frame(RaysRenderer(MODEL), data)
    assert np.array_equal(moved.rgb, fresh.rgb)
    assert np.array_equal(moved.geom_id, fresh.geom_id)


def test_bounds_and_areas_of_triangles():
    rng = np.random.default_rng(0)
    corners = rng.normal(size=(500, 3, 3)).astype(np.float32)
    corners[7, 2] = corners[7, 1]
    np.testing.assert_array_equal(bounds_of(corners), [corners.min(axis=(0, 1)), corners.max(axis=(0, 1))])
    edges = corners[:, 1:].astype(float) - corners[:, :1].astype(float)
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    np.testing.assert_allclose(twice_areas(corners), areas, rtol=1e-12)
    assert np.flatnonzero(twice_areas(corners) == 0).tolist() == [7]
