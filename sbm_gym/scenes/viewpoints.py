"""Where to look at a world from: eye-level views that show objects, and one from above that fills its picture."""

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.rendering.base import Renderer
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.scenes.third_person import FIELD_OF_VIEW_RAD, floor_bounds, opened_model
from sbm_gym.worlds.world import World

TRIAL_PX = (24, 48)
"""Size of the pictures that candidates are judged by."""
CANDIDATES = 72
ENOUGH_SHARE = 0.1
"""An object that fills more of a picture than this is not worth more."""
ELEVATION_RAD = np.deg2rad(52.0)
UNDERGROUND_M = -10.0
"""What waits below this height is not part of the scene."""
_HIDDEN_GROUP = 5


def eye_level_views(
    world: World,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    height_m: float,
    count: int,
    near_m: float = 1.0,
    renderer: Renderer | None = None,
) -> list[Float[np.ndarray, "4 4"]]:
    """Cameras apart from each other where an agent can stand, each with objects and some depth before it.

    Args:
        world: the scene.
        model: its compiled model.
        data: where everything is.
        height_m: height of the cameras.
        count: how many.
        near_m: objects are looked at from this far or farther; surfaces nearer than half of it spoil a view.
        renderer: of the model, if there is one.
    """
    rng = np.random.default_rng(0)
    renderer = renderer or RaysRenderer(model, shadows=False)
    poses = _candidates(world, rng, height_m, near_m)
    trials = [_Trial(world, model, data, renderer, pose, near_m) for pose in poses]
    places = np.array([pose[:2, 3] for pose in poses])
    apart_m = max(1.6, 0.2 * float(np.linalg.norm(np.ptp(places, axis=0))))
    chosen: list[int] = []
    known: set[int] = set()
    while len(chosen) < count:
        distance = np.linalg.norm(places[:, None] - places[chosen], axis=2).min(axis=1, initial=np.inf)
        worth = np.array([trial.worth(known) for trial in trials])
        # Where no place is far enough from all others, the farthest is taken.
        best = int(np.argmax(np.where(distance >= apart_m, worth, distance - 1e3)))
        chosen.append(best)
        known |= set(trials[best].shares)
    return [poses[index] for index in chosen]


def _candidates(world: World, rng: np.random.Generator, height_m: float, near_m: float) -> list[np.ndarray]:
    """Free places, each with a look at one of the objects around it or, where there are none, in any direction."""
    poses = []
    for _ in range(CANDIDATES):
        eye = np.append(world.navigable.random_point(rng), height_m)
        centres = [np.asarray(instance.box_3d.centre_m, float) for instance in world.objects]
        away = np.array([np.linalg.norm(centre[:2] - eye[:2]) for centre in centres])
        near = np.flatnonzero((away >= near_m) & (away < 6.0 * near_m))
        angle = float(rng.uniform(-np.pi, np.pi))
        target = eye + np.array([np.cos(angle), np.sin(angle), -0.1])
        if len(near):
            target = centres[int(rng.choice(near))]
        elif len(away):
            target = centres[int(np.argmax(np.where(away > 0.5 * near_m, -away, -np.inf)))]
        # Level enough that streets and rooms stay in the picture.
        flat = float(np.linalg.norm(target[:2] - eye[:2]))
        target = np.append(target[:2], np.clip(target[2], eye[2] - 0.35 * flat, eye[2] + 0.1 * flat))
        poses.append(look_at(eye, target))
    return poses


class _Trial:
    """What a small picture says about a view."""

    def __init__(self, world: World, model, data, renderer: Renderer, pose, near_m: float) -> None:
        frame = renderer.render(data, Camera.from_fov(pose, TRIAL_PX, 0.5 * np.pi), antialias=False)
        instance_of_geom = np.append(world.instance_of_geom(model), 0)
        ids, counts = np.unique(instance_of_geom[frame.geom_id], return_counts=True)
        self.shares = {int(i): min(n / frame.geom_id.size, ENOUGH_SHARE) for i, n in zip(ids, counts, strict=True) if i}
        """Share of the picture that each object fills, by instance id."""
        depth = np.where(frame.depth_m > 0.0, frame.depth_m, np.inf)
        self._blocked = float((depth < 0.5 * near_m).mean())
        self._open = float(np.mean(np.minimum(depth, 4.0 * near_m))) / (4.0 * near_m)

    def worth(self, known: set[int]) -> float:
        """How much a view shows, objects that other views show counting less."""
        shown = sum(share * (0.3 if i in known else 1.0) for i, share in self.shares.items())
        return shown + 0.25 * self._open - 0.8 * self._blocked


def view_from_above(
    model: mujoco.MjModel, data: mujoco.MjData, eye_m: float, height_px: int, width_px: int
) -> UInt8[np.ndarray, "h w 3"]:
    """The whole world from a raised camera, as large as the picture allows, without its ceiling."""
    low, high = floor_bounds(model, data)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (0.0, eye_m)])
    camera = fitted_camera(corners, (height_px, width_px), ELEVATION_RAD)
    opened = opened_model(model, data, eye_m)
    opened.geom_group[data.geom_xpos[:, 2] < UNDERGROUND_M] = _HIDDEN_GROUP
    renderer = RaysRenderer(opened)
    picture = renderer.render(data, camera).rgb
    renderer.close()
    return picture


def fitted_camera(points_m: Float[np.ndarray, "n 3"], size: tuple[int, int], elevation_rad: float) -> Camera:
    """A raised camera that looks along the shorter side of what it shows, and just has it all.

    Args:
        points_m: what must be in the picture.
        size: picture height and width, pixels.
        elevation_rad: how far the camera looks down; pi/2 is straight down.
    """
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    middle, extent = 0.5 * (low + high), high - low
    ahead = np.array([0.0, 1.0, 0.0]) if extent[0] >= extent[1] else np.array([-1.0, 0.0, 0.0])
    forward = np.cos(elevation_rad) * ahead - np.sin(elevation_rad) * np.array([0.0, 0.0, 1.0])
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    camera = Camera.from_fov(pose, size, FIELD_OF_VIEW_RAD)
    local = (points_m - middle) @ pose[:3, :3]
    tangent = 0.5 * np.array(size[::-1]) / camera.intrinsics[[0, 1], [0, 1]] / 1.03
    # Along each axis the extreme lines of sight of both sides meet where the camera is as near as it can be.
    across, deep = local[:, :2] / tangent, local[:, 2:]
    upper, lower = (across - deep).max(axis=0), (-across - deep).max(axis=0)
    shift = 0.5 * (upper - lower) * tangent
    pose[:3, 3] = middle + pose[:3, :3] @ np.array([*shift, -0.5 * float((upper + lower).max())])
    return camera
