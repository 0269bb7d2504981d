"""The agent seen from outside, and the window of render_mode="human"."""

import dataclasses

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from labeling.core.geometry import look_at, project
from labeling.core.views import Camera
from sbm_gym.env import viewer_window
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.env.viewer_window import NoScreenError, draw_lines
from sbm_gym.scenes.third_person import above, frustum_lines, overview_camera
from sbm_gym.worlds.world import Arrangement, World

from ..box_rooms import BoxRooms


def outside_env(**options):
    return FixationEnv(BoxRooms(), render_mode="third_person", render_size=(200, 260), **options)


def render(env):
    picture = env.render()
    assert picture is not None
    return picture


def differing(a, b):
    return np.abs(a.astype(int) - b).max(axis=-1) > 40


def test_the_robot_its_frustum_and_its_path_are_drawn():
    env = outside_env(gaze="free")
    env.reset(seed=0, options={"start": (-1.0, -1.5, 0.0)})
    before = render(env)
    assert before.shape == (200, 260, 3)
    assert before.dtype == np.uint8
    orange = (before[..., 0] > 200) & (before[..., 1] > 80) & (before[..., 1] < 170) & (before[..., 2] < 80)
    assert orange.sum() > 60
    for _ in range(4):
        env.step(np.array([0.0, -0.6, 0.0, 0.0], np.float32))
    after = render(env)
    changed = differing(before, after)
    assert 50 < changed.sum() < 0.3 * changed.size
    path = (np.abs(after.astype(int) - [255, 190, 40]).max(axis=-1) < 40).sum()
    assert path > (np.abs(before.astype(int) - [255, 190, 40]).max(axis=-1) < 40).sum() + 10


def test_pictures_from_outside_change_nothing():
    plain, seen = FixationEnv(BoxRooms()), outside_env()
    plain.reset(seed=3)
    seen.reset(seed=3)
    for _ in range(3):
        seen.render()
        action = np.array([0.5, 0.2, 0.1, 0.0], np.float32)
        a, b = plain.step(action), seen.step(action)
        assert all(np.array_equal(a[0][key], b[0][key]) for key in a[0])
        assert a[1] == b[1]


def test_the_view_follows_to_another_scene():
    env = outside_env()
    env.reset(seed=0, options={"scene": "box_0", "start": (-1.0, -1.5, 0.0)})
    first = render(env)
    env.reset(seed=0, options={"scene": "box_2", "start": (-1.0, -1.5, 0.0)})
    assert differing(first, render(env)).any()
    env.close()


def test_ceilings_are_taken_off_and_walls_are_not():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='plane' size='0 0 1' pos='0 0 5'/>"
        "<geom type='box' size='3 3 .05' pos='0 0 2.6'/><geom type='box' size='.1 3 1.3' pos='3 0 1.3'/>"
        "<geom type='box' size='.1 1 .1' pos='0 0 2.2' euler='90 0 0'/></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert above(model, data, 1.8).tolist() == [False, True, False, False]


@pytest.mark.parametrize("size", [(200, 300), (300, 200)])
@pytest.mark.parametrize("reach", [(4.0, 2.0), (2.0, 4.0)])
def test_overview_has_the_whole_ground_in_sight(size, reach):
    target = np.array([1.0, -2.0, 0.6])
    camera = overview_camera(target, np.array(reach), size, np.deg2rad(70))
    corners = np.array(
        [[target[0] + sx * reach[0], target[1] + sy * reach[1], 0.0] for sx in (-1, 1) for sy in (-1, 1)]
    )
    pixels, depth = project(corners, camera.intrinsics, camera.camera_to_world)
    assert (depth > 0).all()
    assert (pixels >= -0.5).all()
    assert (pixels <= np.array([size[1], size[0]]) - 0.5).all()


def test_frustum_ends_are_the_corners_of_the_picture():
    pose = look_at(np.array([1.0, 2.0, 1.5]), np.zeros(3))
    camera = Camera.from_fov(pose, (64, 96), np.deg2rad(75))
    lines = frustum_lines(camera, depth_m=0.8)
    pixels, depth = project(np.stack([line[1] for line in lines[:4]]), camera.intrinsics, pose)
    assert np.allclose(depth, 0.8)
    assert np.allclose(pixels, [[-0.5, -0.5], [95.5, -0.5], [95.5, 63.5], [-0.5, 63.5]])
    assert all(np.allclose(line[0], pose[:3, 3]) for line in lines[:4])


def test_human_mode_without_a_screen_is_one_clear_error(monkeypatch):
    monkeypatch.setattr(viewer_window.platform, "system", lambda: "Linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    import sbm_gym  # registers the environments

    assert sbm_gym.__name__
    for make in (
        lambda: FixationEnv(BoxRooms(), render_mode="human"),
        lambda: gym.make("sbm_gym/Indoor-v0", worlds=BoxRooms(), render_mode="human"),
    ):
        with pytest.raises(NoScreenError, match="third_person"):
            make()
    assert "human" not in FixationEnv(BoxRooms()).metadata["render_modes"]
    monkeypatch.setenv("DISPLAY", ":0")
    assert "human" in FixationEnv(BoxRooms()).metadata["render_modes"]


def test_human_mode_keeps_the_viewer_up_to_date(monkeypatch):
    """With a viewer that only counts: a window for each scene, a refresh for each step, closed at the end."""

    class Viewer:
        def __init__(self, model):
            self.user_scn, self.synced, self.closed = mujoco.MjvScene(model, maxgeom=100), 0, False

        def is_running(self):
            return not self.closed

        def lock(self):
            import contextlib

            return contextlib.nullcontext()

        def sync(self):
            self.synced += 1

        def close(self):
            self.closed = True

    opened = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer_window, "_launch", lambda model, data: opened.append(Viewer(model)) or opened[-1])
    env = FixationEnv(BoxRooms(), render_mode="human")
    env.reset(seed=0, options={"scene": "box_0"})
    for _ in range(2):
        env.step(np.array([0.5, 0, 0, 0], np.float32))
    assert env.render() is None
    assert [viewer.synced for viewer in opened] == [4]
    assert opened[0].user_scn.ngeom == 2 + 8  # two strides of path, eight edges of the frustum
    env.reset(seed=0, options={"scene": "box_1"})
    assert [viewer.closed for viewer in opened] == [True, False]
    env.close()
    assert opened[1].closed


def test_lines_beyond_what_a_viewer_holds_are_left_out():
    env = outside_env()
    env.reset(seed=0)
    scene = mujoco.MjvScene(env.scene.model, maxgeom=3)
    assert env._simulation is not None
    draw_lines(scene, env._simulation.trace())
    assert scene.ngeom == 3


class WeatherStage:
    """Draws how strong the lamp is, and nothing else."""

    def __init__(self, world: World) -> None:
        self._world = world

    def arrange(self, rng: np.random.Generator) -> Arrangement:
        strength = float(rng.uniform(0.1, 0.9))

        def apply(model: mujoco.MjModel) -> None:
            model.light_diffuse[:] = strength

        return Arrangement(self._world.objects, self._world.navigable, self._world.navigable, apply)


class WeatherRooms(BoxRooms):
    """Box rooms whose light every episode draws."""

    def build(self, scene: str) -> World:
        world = super().build(scene)
        return dataclasses.replace(world, stage=WeatherStage(world))


def test_pictures_from_outside_have_the_light_of_their_episode():
    def picture(*seeds: int) -> np.ndarray:
        env = FixationEnv(WeatherRooms(2), render_mode="third_person", render_size=(80, 100))
        for seed in seeds:
            env.reset(seed=seed)
            found = render(env)
        env.close()
        return found

    assert np.array_equal(picture(1, 5), picture(5))
    assert not np.array_equal(picture(1), picture(5))
