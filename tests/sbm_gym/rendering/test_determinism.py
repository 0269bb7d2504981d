"""The ray renderer gives the same bytes in any process, with any number of threads."""

import hashlib
import itertools
import os
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.rendering.rays.reused_arrays import ReusedArrays
from sbm_gym.rendering.rays.workers import Workers


def cluttered_model(glass: bool = False) -> mujoco.MjModel:
    """Boxes that touch, overlap and share faces: the places where equal hits could be told apart by chance."""
    rng = np.random.default_rng(5)
    geoms = ['<geom type="plane" size="5 5 1" rgba=".6 .5 .4 1"/>']
    for _ in range(60):
        x, y = np.round(rng.uniform(-2, 2, 2), 1)
        alpha = 0.4 if glass and rng.random() < 0.2 else 1
        colour = " ".join(f"{c:.2f}" for c in rng.uniform(0.2, 0.9, 3))
        kind = rng.choice(["box", "sphere", "cylinder"])
        geoms.append(f'<geom type="{kind}" size=".2 .2 .2" pos="{x} {y} .2" rgba="{colour} {alpha}"/>')
    lights = '<light pos="0 0 4" castshadow="true"/><light type="directional" dir="1 1 -2"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{lights}{''.join(geoms)}</worldbody></mujoco>")


def picture_hash(glass: bool = False) -> str:
    model = cluttered_model(glass)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = RaysRenderer(model)
    digest = hashlib.sha256()
    for eye in ((3.0, 0.5, 2.0), (-2.5, -2.5, 1.5), (2.5, 2.8, 0.25)):
        camera = Camera.from_fov(look_at(np.array(eye), np.array([0.0, 0.0, 0.2])), (90, 120), 1.2)
        frame = renderer.render(data, camera)
        for picture in (frame.rgb, frame.depth_m, frame.geom_id):
            digest.update(np.ascontiguousarray(picture).tobytes())
        digest.update(renderer.amodal_mask(data, [3, 4], camera).tobytes())
    return digest.hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("threads", ["1", pytest.param("2", marks=pytest.mark.nightly)])
def test_other_processes_and_thread_counts_give_the_same_bytes(threads):
    environment = {**os.environ, "NUMBA_NUM_THREADS": threads, "PYTHONPATH": os.pathsep.join(sys.path)}
    result = subprocess.run(
        [sys.executable, __file__], env=environment, capture_output=True, text=True, timeout=120, check=True
    )
    assert result.stdout.strip() == picture_hash()


@pytest.mark.slow
def test_pictures_do_not_depend_on_what_memory_held(monkeypatch):
    def pictures() -> str:
        return picture_hash(glass=True)

    before, poison = pictures(), itertools.cycle([0, 255, 113])
    original = ReusedArrays.take

    def take(self, name, shape, dtype=np.float32):
        array = original(self, name, shape, dtype)
        array.view(np.uint8)[...] = next(poison)
        return array

    monkeypatch.setattr(ReusedArrays, "take", take)
    for _ in range(3):
        assert pictures() == before
        next(poison)


def test_workers_cover_every_ray_once():
    counts = np.zeros(10_001, np.int64)

    def kernel(start, stop, counts):
        counts[start:stop] += 1

    Workers(3).split(kernel, len(counts), counts)
    assert (counts == 1).all()


def test_errors_in_worker_threads_reach_the_caller():
    def kernel(start, stop):
        if start > 0:
            raise RuntimeError("part failed")

    with pytest.raises(RuntimeError, match="part failed"):
        Workers(2).split(kernel, 10_000)


if __name__ == "__main__":
    print(picture_hash())
