"""Both renderers draw the same thing: the acceptance of every named scene."""

from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest

from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.rendering.gl.renderer import GlRenderer
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.scenes.world_sources import WORLDS, world_source

HEIGHT_PX, WIDTH_PX = 160, 240
SCENES = [(kind, scene) for kind in WORLDS for scene in world_source(kind).scenes(None)]
SAMPLE = [("indoor", "train/00"), ("outdoor-builtin", "town/test/00")]
"""What every run looks at: furniture of the libraries in rooms, builtin models in streets; the others take minutes."""


def assert_agreement(kind, scene):
    world = world_source(kind).build(scene)
    model = world.spec.compile()
    world = replace(world, bare=mujoco.MjSpec(), left_out=None)  # needs as much memory as the model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    gl, rays = GlRenderer(model, shadows="off"), RaysRenderer(model, shadows=False)
    instance = np.append(world.instance_of_geom(model), 0)
    rng = np.random.default_rng(0)
    for target in (world.objects[0].box_3d.centre_m, world.objects[-1].box_3d.centre_m):
        eye = np.array([*world.navigable.random_point(rng), 1.5])
        camera = Camera.from_fov(look_at(eye, np.asarray(target, float)), (HEIGHT_PX, WIDTH_PX), 0.5 * np.pi)
        ours, theirs = gl.render(data, camera, antialias=False), rays.render(data, camera, antialias=False)
        assert np.median(np.abs(ours.depth_m - theirs.depth_m)) < 1e-3
        square = np.ones((3, 3), np.uint8)
        ids = theirs.geom_id.astype(np.float32)
        inside = cv2.dilate(ids, square) == cv2.erode(ids, square)
        assert inside.mean() > 0.3
        assert np.mean((instance[ours.geom_id] == instance[theirs.geom_id])[inside]) >= 0.995
    gl.close()


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "scene"), SAMPLE)
def test_renderers_agree(kind, scene):
    assert_agreement(kind, scene)


@pytest.mark.nightly
@pytest.mark.parametrize(("kind", "scene"), SCENES)
def test_renderers_agree_on_every_named_scene(kind, scene):
    assert_agreement(kind, scene)
