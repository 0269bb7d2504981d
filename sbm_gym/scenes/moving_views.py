"""A scene in which things move, from one place and at several moments: what its picture shows."""

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.scenes.compiled import Scene
from sbm_gym.worlds.moving.movers import Traffic

TRIAL_PX = (24, 48)
"""Size of the pictures that places are judged by."""
PLACES = 120
ENOUGH_SHARE = 0.06
"""Things that fill more of a picture than this are worth no more."""
NOBODY_M = np.array([1e6, 1e6])
"""Where a robot stands that is in nobody's way."""


def moments(
    scene: Scene, count: int, seconds: float, size: tuple[int, int], rng: np.random.Generator
) -> list[UInt8[np.ndarray, "h w 3"]]:
    """Pictures of what moves, from the place of some at random that shows most of it.

    Args:
        scene: as an episode finds it, with things that are about to move.
        count: how many pictures.
        seconds: between two of them.
        size: height and width of the pictures, pixels.
        rng: draws places to look from.
    """
    assert scene.arrangement is not None
    traffic = Traffic(scene.arrangement.movers, 0.0)
    poses = [traffic.poses()]
    for _ in range(count - 1):
        traffic.advance(seconds, NOBODY_M)
        poses.append(traffic.poses())
    height_m = float(scene.body.camera_to_world[2, 3]) or 1.5
    cameras = [_camera(scene, poses, height_m, rng) for _ in range(PLACES)]
    worth = np.zeros(len(cameras))
    for state in poses:
        scene = _at(scene, state)
        ids = [one.instance_id for one in scene.arrangement.movers] if scene.arrangement else []
        for k, pose in enumerate(cameras):
            frame = scene.renderer.render(
                scene.data, Camera.from_fov(pose, TRIAL_PX, 0.5 * np.pi), antialias=False, colours=False
            )
            shown = np.isin(scene.instance_of_geom[frame.geom_id], ids)
            blocked = np.mean((frame.depth_m > 0) & (frame.depth_m < 0.8))
            # Roots, so that to be seen at every moment is worth more than to fill one picture.
            worth[k] += min(float(np.mean(shown)), ENOUGH_SHARE) ** 0.5 - 0.5 * float(blocked)
    chosen = Camera.from_fov(cameras[int(np.argmax(worth))], size, 0.5 * np.pi)
    pictures = []
    for state in poses:
        scene = _at(scene, state)
        pictures.append(scene.renderer.render(scene.data, chosen).rgb)
    return pictures


def _at(scene: Scene, poses: dict[int, Float[np.ndarray, "4 4"]]) -> Scene:
    moved = scene.moved(poses)
    mujoco.mj_forward(moved.model, moved.data)
    return moved


def _camera(scene: Scene, poses, height_m: float, rng) -> Float[np.ndarray, "4 4"]:
    """From a free place towards where one of the moving things is half-way."""
    eye = np.append(scene.world.navigable.random_point(rng), height_m)
    halfway = poses[len(poses) // 2]
    target = halfway[list(halfway)[int(rng.integers(len(halfway)))]][:3, 3]
    flat_m = float(np.linalg.norm(target[:2] - eye[:2]))
    return look_at(eye, np.append(target[:2], max(0.4, height_m - 0.35 * flat_m)))
