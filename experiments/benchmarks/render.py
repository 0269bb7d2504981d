"""Pictures per second of both renderers, beside ``mujoco.Renderer`` in one furnished room, and costs of scenes."""

import copy
import gc
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from experiments.benchmarks.rows import Row, log, median_seconds
from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.rendering.base import Renderer
from sbm_gym.rendering.gl.context import GlContext, NoOpenGlError
from sbm_gym.rendering.gl.renderer import GlRenderer
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.scenes.world_sources import world_source
from sbm_gym.worlds.world import World

BASELINE = "mujoco.Renderer, 3 passes"
SCENE = "train/00"
NUM_VIEWS = 6
RESETS, SCENES, SAMPLES = 3000, 10, 20
GROWTH_MB = 16.0
"""Memory that so many resets may add from the first quarter of the samples to the last, medians of either, for
allocators' sake: single samples differ by 40. A leak of one small picture a reset would exceed it."""


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row.

    Args:
        quick: few repetitions.
    """
    world = world_source("indoor").build(SCENE)
    model = world.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    cameras = views(world)
    triangles = int(sum(model.mesh_facenum[model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]]))
    device = _device()
    log(f"{SCENE}: {len(world.objects)} objects, {triangles} triangles, {model.nlight} lamps; OpenGL: {device}")
    repeats = 1 if quick else 5
    rays, gl = RaysRenderer(model), GlRenderer(model)
    for size, antialias in ((84, False), (256, True)):
        what = f"rgb with shadows, depth, ids, {size}x{size}" + (", smooth edges" if antialias else "")
        ours = {
            name: median_seconds(_all(renderer, data, cameras, size, antialias), repeats) / NUM_VIEWS
            for name, renderer in (("rays", rays), ("gl", gl))
        }
        for shadows, factor in ((True, {84: 12.0}), (False, {84: 15.0, 256: 4.0})):
            theirs = median_seconds(baseline(model, data, cameras, size, antialias, shadows), repeats) / NUM_VIEWS
            for name, seconds in ours.items():
                wanted = factor.get(size) if name == "rays" else None
                target, holds = ("", None) if wanted is None else (f"{wanted:g}x", bool(theirs >= wanted * seconds))
                shown = f"{BASELINE}, its shadows {'on' if shadows else 'off'}"
                yield Row(f"{name}: {what}", shown, seconds, theirs, target, holds, f"OpenGL: {device}")
    gl.close()
    yield from scene_costs(quick)


def views(world: World) -> list[Float[np.ndarray, "4 4"]]:
    """Cameras at eye level that look at objects from where an agent can stand."""
    rng = np.random.default_rng(0)
    targets = [world.objects[index % len(world.objects)].box_3d.centre_m for index in range(NUM_VIEWS)]
    return [look_at(np.array([*world.navigable.random_point(rng), 1.5]), target) for target in targets]


def _all(renderer: Renderer, data, cameras, size: int, antialias: bool) -> Callable[[], None]:
    def draw() -> None:
        for pose in cameras:
            renderer.render(data, Camera.from_fov(pose, (size, size), 0.5 * np.pi), antialias=antialias)

    return draw


def baseline(model, data, cameras, size: int, antialias: bool, shadows: bool) -> Callable[[], None]:
    """Colour, depth and segmentation as ``mujoco.Renderer`` draws them: one pass each, from the same place."""
    model = copy.copy(model)
    model.vis.quality.offsamples = 4 if antialias else 0
    model.vis.global_.fovy = 90.0
    # It draws no point lights, and their empty shadow maps would cost it little: it gets lamps that it can draw.
    lamps = model.light_type == mujoco.mjtLightType.mjLIGHT_POINT
    model.light_type[lamps], model.light_cutoff[lamps] = int(mujoco.mjtLightType.mjLIGHT_SPOT), 80.0
    baseline = mujoco.Renderer(model, size, size)
    baseline.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(shadows)
    camera = mujoco.MjvCamera()
    modes = baseline.disable_depth_rendering, baseline.enable_depth_rendering, baseline.enable_segmentation_rendering

    def draw() -> None:
        for pose in cameras:
            forward = pose[:3, 2]
            camera.lookat, camera.distance = pose[:3, 3] + forward, 1.0
            camera.azimuth = np.rad2deg(np.arctan2(forward[1], forward[0]))
            camera.elevation = np.rad2deg(np.arcsin(forward[2]))
            for choose in modes:
                baseline.update_scene(data, camera)
                choose()
                baseline.render()
            baseline.disable_segmentation_rendering()

    return draw


def _device() -> str:
    try:
        context = GlContext()
    except NoOpenGlError:
        return "none"
    context.free()
    return context.renderer_name


def scene_costs(quick: bool) -> Iterator[Row]:
    """What it takes to start again in a scene, and whether memory stays where it is."""
    from sbm_gym.env.fixation_env import FixationEnv

    env = FixationEnv(split=None, scene_cache=1)
    env.reset(seed=0, options={"scene": env.scene_names[0]})
    reset = partial(env.reset, options={"reuse_scene": True})
    known = median_seconds(reset, 5 if quick else 50)
    yield Row("reset in a known scene", "limit", known, None, "< 50 ms", known < 0.05)
    env.close()
    env = FixationEnv(split=None)
    resets, scenes = (20, 2) if quick else (RESETS, SCENES)
    names = cycle(env.scene_names[:scenes])
    for _ in range(resets):  # the heap settles only after some two thousand
        env.reset(options={"scene": next(names)})
    started, samples = time.perf_counter(), []
    for number in range(resets):
        env.reset(options={"scene": next(names)})
        if number % (resets // SAMPLES) == 0:
            gc.collect()
            samples.append(resident_mb())
    seconds = (time.perf_counter() - started) / resets
    before, after = (float(np.median(some)) for some in (samples[: SAMPLES // 4], samples[-SAMPLES // 4 :]))
    growth, what = after - before, f"{resets} resets in {scenes} scenes: {before:.0f} MB before, {after:.0f} MB after"
    yield Row(what, "limit", seconds, None, f"< {GROWTH_MB:g} MB more", growth < GROWTH_MB, f"{growth:+.1f} MB")
    env.close()


def resident_mb() -> float:
    """Memory that this process holds, MB."""
    statm = Path("/proc/self/statm").read_text(encoding="ascii")
    return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
