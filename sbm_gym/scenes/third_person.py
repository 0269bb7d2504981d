"""A look at the agent from outside: its body, camera, path and known objects in a world without its ceiling."""

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, UInt8

from labeling.core.views import Camera
from sbm_gym.rendering.base import Renderer
from sbm_gym.rendering.tables.lights import clear_haze
from sbm_gym.robot.object_memory import KnownObject
from sbm_gym.worlds.world import Arrangement

HEADROOM_M = 0.3
"""What begins this far above the agent's camera is taken off: ceilings, lamps, roofs."""
CEILING_M = 3.0
"""Ceilings are at most this far above the agent's camera."""
FIELD_OF_VIEW_RAD = np.deg2rad(40.0)
"""Narrow, so that walls do not lean outwards."""
ELEVATION_RAD = np.deg2rad(68.0)
"""Steep enough that the near wall hides little, low enough that furniture can be told."""
MAX_REACH_M = 5.5
"""At most this far around the agent is shown."""
FRUSTUM_M = 0.7
"""Depth of the drawn frustum."""
_HIDDEN_GROUP = mujoco.mjNGROUP - 1
_BODY_RGBA = (0.95, 0.45, 0.1, 1.0)
_PATH, _FRUSTUM, _FOUND, _TARGET = (255, 190, 40), (255, 120, 20), (60, 160, 255), (255, 60, 90)
"""Colours of what is drawn over the picture, RGB."""


@dataclass(frozen=True)
class AgentTrace:
    """What is to be shown of an agent."""

    camera: Camera
    path_m: Sequence[Float[np.ndarray, "2"]] = ()
    """Where it stood at every view, the present place last."""
    objects: Sequence[KnownObject] = ()
    target: KnownObject | None = None
    """The one of them that it fixates."""


class ThirdPersonView:
    """Draws one compiled model from above, with any renderer."""

    def __init__(
        self, model: mujoco.MjModel, make_renderer: Callable[[mujoco.MjModel], Renderer], camera_height_m: float
    ) -> None:
        """Prepares to draw; the first picture takes as long as a new scene.

        Args:
            model: the compiled model with the agent in it; a copy of it is drawn.
            make_renderer: makes a renderer for the copy.
            camera_height_m: height of the agent's camera.
        """
        self._model = model
        self._make_renderer, self._camera_height_m = make_renderer, camera_height_m
        self._renderer: Renderer | None = None
        self._opened: mujoco.MjModel | None = None

    def arrange(self, arrangement: Arrangement) -> None:
        """Arranges what is drawn as another episode has it: weather, light and what stands where."""
        if self._opened is not None:
            arrangement.apply(self._opened)
            clear_haze(self._opened)

    def draw(self, data: mujoco.MjData, trace: AgentTrace, height_px: int, width_px: int) -> UInt8[np.ndarray, "h w 3"]:
        """Draws the scene as it stands in ``data``, and the agent's doings over it.

        Args:
            data: state of the scene.
            trace: what the agent saw and did.
            height_px: picture height.
            width_px: picture width.
        """
        if self._renderer is None:
            opened = opened_model(self._model, data, self._camera_height_m)
            torso = opened.geom("agent_torso").id
            opened.geom_group[torso], opened.geom_rgba[torso] = 0, _BODY_RGBA
            self._renderer, self._opened = self._make_renderer(opened), opened
        camera = self._camera(data, trace, (height_px, width_px))
        picture = self._renderer.render(data, camera).rgb.copy()
        _Overlay(picture, camera).trace(trace)
        return picture

    def close(self) -> None:
        """Gives back what the renderer holds."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _camera(self, data: mujoco.MjData, trace: AgentTrace, size: tuple[int, int]) -> Camera:
        """Looks down at the whole world if it is small, else at the agent's surroundings."""
        low, high = floor_bounds(self._model, data)
        here = np.asarray(trace.camera.camera_to_world, float)[:2, 3]
        reach = np.minimum((high - low) / 2, MAX_REACH_M)
        centre = np.clip(here, low + reach, np.maximum(high - reach, low + reach))
        return overview_camera(np.array([*centre, 0.6]), reach, size, ELEVATION_RAD)


def opened_model(model: mujoco.MjModel, data: mujoco.MjData, eye_m: float) -> mujoco.MjModel:
    """A copy of a model for pictures from above: without ceilings, if most places have one, and without haze.

    Args:
        model: the compiled model.
        data: where everything is.
        eye_m: height of the agent's camera.
    """
    opened = copy.copy(model)
    placed = mujoco.MjData(model)  # what is handed over may be of a model without meshes
    placed.qpos[:], placed.mocap_pos[:], placed.mocap_quat[:] = data.qpos, data.mocap_pos, data.mocap_quat
    mujoco.mj_kinematics(model, placed)
    data = placed
    if _has_ceiling(model, data, eye_m):
        opened.geom_group[above(model, data, eye_m + HEADROOM_M)] = _HIDDEN_GROUP
    clear_haze(opened)
    return opened


def _has_ceiling(model: mujoco.MjModel, data: mujoco.MjData, eye_m: float) -> bool:
    """Whether something hangs over most of a grid of places, close above the camera. Roofs of houses are higher."""
    low, high = floor_bounds(model, data)
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    hit = np.zeros(1, np.int32)
    share = (np.arange(7) + 0.5) / 7
    found = [
        0.0
        <= mujoco.mj_ray(model, data, np.array([x, y, eye_m]), np.array([0.0, 0.0, 1.0]), groups, 1, -1, hit)
        < CEILING_M
        for x in low[0] + share * (high[0] - low[0])
        for y in low[1] + share * (high[1] - low[1])
    ]
    return float(np.mean(found)) > 0.5


def above(model: mujoco.MjModel, data: mujoco.MjData, height_m: float) -> Bool[np.ndarray, "ngeom"]:
    """Geoms that lie above a height, all of them."""
    centre, half = _world_bounds(model, data)
    return (centre[:, 2] - half[:, 2] >= height_m) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)


def floor_bounds(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Smallest and largest x and y of what can be touched, else of everything; 10 m squared if all is endless."""
    centre, half = _world_bounds(model, data)
    agent = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "agent")
    bounded = (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE) & (model.geom_bodyid != agent)
    touched = bounded & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))
    bounded = touched if touched.any() else bounded
    if not bounded.any():
        return np.full(2, -5.0), np.full(2, 5.0)
    return (centre - half)[bounded, :2].min(axis=0), (centre + half)[bounded, :2].max(axis=0)


def _world_bounds(
    model: mujoco.MjModel, data: mujoco.MjData
) -> tuple[Float[np.ndarray, "ngeom 3"], Float[np.ndarray, "ngeom 3"]]:
    """Centres and half sides of upright boxes around all geoms."""
    rotation = data.geom_xmat.reshape(-1, 3, 3)
    centre = data.geom_xpos + np.einsum("nij,nj->ni", rotation, model.geom_aabb[:, :3])
    return centre, np.einsum("nij,nj->ni", np.abs(rotation), model.geom_aabb[:, 3:])


def overview_camera(
    target_m: Float[np.ndarray, "3"], reach_m: Float[np.ndarray, "2"], size: tuple[int, int], elevation_rad: float
) -> Camera:
    """A raised camera that looks north and has a rectangle of ground in sight.

    Args:
        target_m: middle of the rectangle.
        reach_m: half sides of the rectangle along x and y.
        size: picture height and width, pixels.
        elevation_rad: how far the camera looks down; pi/2 is straight down.
    """
    right = np.array([1.0, 0.0, 0.0])
    forward = np.array([0.0, np.cos(elevation_rad), -np.sin(elevation_rad)])
    camera_to_world = np.eye(4)
    camera_to_world[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    camera = Camera.from_fov(camera_to_world, size, FIELD_OF_VIEW_RAD)
    # Near corners of the ground and the tops of the far wall must both fit; the worse of the two decides.
    tan_x, tan_y = 0.5 * size[1] / camera.intrinsics[0, 0], 0.5 * size[0] / camera.intrinsics[1, 1]
    sin, cos = np.sin(elevation_rad), np.cos(elevation_rad)
    distance = reach_m[1] * cos + max(reach_m[0] / tan_x, reach_m[1] * sin / tan_y) * 1.08 + 1.2
    camera_to_world[:3, 3] = target_m - distance * forward
    return camera


class _Overlay:
    """Lines and words over a picture, placed in the world."""

    def __init__(self, picture: UInt8[np.ndarray, "h w 3"], camera: Camera) -> None:
        self._picture, self._intrinsics = picture, camera.intrinsics
        self._world_to_camera = np.linalg.inv(camera.camera_to_world)
        # Lines about as thick as in a picture of 512 pixels, whatever the size.
        self._width = max(1, round(min(picture.shape[:2]) / 300))

    def trace(self, trace: AgentTrace) -> None:
        path = np.array([[*place, 0.03] for place in trace.path_m]).reshape(-1, 3)
        self._line(path, _PATH, dots=True)
        for known in trace.objects:
            self._object(known, _TARGET if known is trace.target else _FOUND)
        for line in frustum_lines(trace.camera):
            self._line(line, _FRUSTUM)

    def _pixels(self, points: Float[np.ndarray, "n 3"]) -> np.ndarray | None:
        if len(points) == 0:
            return None
        camera = points @ self._world_to_camera[:3, :3].T + self._world_to_camera[:3, 3]
        if camera[:, 2].min() < 1e-3:
            return None
        image = camera @ self._intrinsics.T
        # cv2 takes fixed-point coordinates, here with four fractional bits.
        return np.rint(16 * image[:, :2] / image[:, 2:]).astype(np.int32)

    def _line(self, points, colour, dots: bool = False) -> None:
        import cv2

        pixels = self._pixels(points)
        if pixels is None:
            return
        cv2.polylines(self._picture, [pixels], False, colour, self._width, cv2.LINE_AA, shift=4)
        for pixel in pixels if dots else ():
            cv2.circle(self._picture, tuple(pixel.tolist()), 16 * (self._width + 1), colour, -1, cv2.LINE_AA, shift=4)

    def _object(self, known: KnownObject, colour: tuple[int, int, int]) -> None:
        from labeling.inspection.titles import write_title

        label = f"{known.category} {known.best_confidence:.2f}"
        around = np.linspace(0.0, 2.0 * np.pi, 33)[:, None]
        radius = 0.5 * max(float(np.max(known.extent_m)), 0.2)
        ring = known.centroid_m + radius * np.concatenate([np.cos(around), np.sin(around), 0 * around], axis=1)
        self._line(ring, colour)
        pixels = self._pixels(known.centroid_m[None])
        if pixels is None:
            return
        x, y = (pixels[0] / 16).tolist()
        write_title(self._picture, label, (x, y), max(0.3, min(self._picture.shape[:2]) / 900))


def frustum_lines(camera: Camera, depth_m: float = FRUSTUM_M) -> list[Float[np.ndarray, "n 3"]]:
    """The edges of what a camera sees up to a depth: four from the camera, and the rectangle at the end."""
    height_px, width_px = camera.size
    corners = np.array([[x, y, 1.0] for x, y in ((0, 0), (width_px, 0), (width_px, height_px), (0, height_px))])
    corners[:, :2] -= 0.5
    camera_to_world = np.asarray(camera.camera_to_world, float)
    far = depth_m * corners @ np.linalg.inv(camera.intrinsics).T @ camera_to_world[:3, :3].T + camera_to_world[:3, 3]
    eye = camera_to_world[:3, 3]
    return [np.stack([eye, corner]) for corner in far] + [np.concatenate([far, far[:1]])]
