"""The simulation of one episode: a robot in a scene that moves, looks and detects."""

import functools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int32, UInt8

from labeling.core.types import Detection
from labeling.core.views import Camera
from labeling.generator.calibration.detector_calibration import calibration_of
from labeling.generator.objects.object_posterior import ObjectModel
from sbm_gym.atlas.scene_atlas import SceneAtlas
from sbm_gym.atlas.stored_views import StoredView
from sbm_gym.env.gaze import PITCH_RAD, TILT_RAD, TURN_RAD, yaw_offset_rad
from sbm_gym.env.recording import Capture, ground_truth_of_view, moving_objects
from sbm_gym.env.view_detectors import View, ViewDetector
from sbm_gym.rendering.base import Frame
from sbm_gym.robot.object_memory import MemoryUpdate
from sbm_gym.robot.state import RobotConfig, RobotState
from sbm_gym.scenes.compiled import Scene
from sbm_gym.scenes.third_person import AgentTrace
from sbm_gym.worlds.moving.movers import Traffic

GAZES = ("fixate", "free")


@dataclass(frozen=True)
class SimulationConfig:
    """What stays the same from episode to episode."""

    robot: RobotConfig
    image_size: tuple[int, int]
    """Height and width of what the robot sees at every step, pixels."""
    antialias: bool
    colours: bool
    """Whether what the robot sees at every step has colours."""
    detector_size: tuple[int, int]
    """Height and width of what a detector that needs detail looks at, pixels; with smooth edges."""
    gaze: str
    """One of ``GAZES``."""


class Simulation:
    """A robot in a scene, from its first look on."""

    def __init__(
        self,
        scene: Scene,
        config: SimulationConfig,
        detector: ViewDetector,
        entropy: int,
        position_m: Float[np.ndarray, "2"],
        yaw_rad: float,
        num_views: int,
        atlas: SceneAtlas | None = None,
    ) -> None:
        """Puts the robot down and has it look.

        Args:
            scene: as this episode finds it.
            config: of the environment.
            detector: detects in what the robot sees.
            entropy: seeds the detector's noise.
            position_m: where the robot starts.
            yaw_rad: its heading.
            num_views: steps of the episode.
            atlas: holds what there is to see; the robot then keeps to its poses.
        """
        self.scene, self._config, self._detector, self._entropy = scene, config, detector, entropy
        self._atlas = atlas
        self.robot = RobotState(
            config.robot, scene.world.navigable, position_m, num_views, functools.partial(_object_model, detector.name)
        )
        """What the robot knows."""
        self.num_views, self.step_index, self.collided, self.path_m = num_views, 0, False, 0.0
        movers = () if scene.arrangement is None else scene.arrangement.movers
        self._traffic = Traffic(movers, config.robot.body.radius_m) if movers else None
        scene.body.place(position_m, yaw_rad, config.robot.rest_tilt_rad)
        self._keep_to_places()
        self._keep_to_headings()
        self._places_m = [scene.body.position_m]
        self.update = self._look()
        """What the last look taught it."""

    def act(self, action: Float[np.ndarray, "4"]) -> None:
        """Moves, turns the camera, looks.

        Args:
            action: forward, left, gaze yaw and gaze pitch, each in [-1, 1].
        """
        body = self.scene.body
        before = body.position_m
        displacement_m = displacement_of(action[:2], body.yaw_rad, self._config.robot.stride_m)
        way_is_free = self.scene.world.navigable.line_is_free(before, before + displacement_m)
        if self._traffic is not None:
            way_is_free &= not self._traffic.is_near(before, before + displacement_m)
        self.collided = body.move(displacement_m, way_is_free=way_is_free)
        self._keep_to_places()
        self.path_m += float(np.linalg.norm(body.position_m - before))
        self._places_m.append(body.position_m)
        if self._traffic is not None:
            self._traffic.advance(self._config.robot.step_s, body.position_m)
            self.scene = self.scene.moved(self._traffic.poses())
        self._aim(action[2:])
        self._keep_to_headings()
        self.step_index += 1
        self.update = self._look()

    def draw(self, height_px: int, width_px: int, antialias: bool, colours: bool = True) -> View:
        """What the camera sees now; the field of view is 90 degrees across."""
        camera = Camera.from_fov(self.scene.body.camera_to_world, (height_px, width_px), 0.5 * np.pi)
        frame = self.scene.renderer.render(self.scene.data, camera, antialias=antialias, colours=colours)
        return View(frame, self.scene.instance_of_geom[frame.geom_id], camera)

    def capture(self, height_px: int, width_px: int) -> Capture:
        """A full frame of the current view. Changes nothing."""
        same_picture = self._detector.needs_detail and self._config.detector_size == (height_px, width_px)
        if same_picture and self._atlas is None:
            view, detections = self.sight, self.detections
        else:
            view = self.draw(height_px, width_px, antialias=True)
            detections = self.detections if same_picture else self._detect(view)
        return Capture(
            rgb=view.frame.rgb,
            depth_m=view.frame.depth_m,
            intrinsics=view.camera.intrinsics,
            camera_to_world=view.camera.camera_to_world,
            detections=tuple(detections),
            ground_truth=ground_truth_of_view(self.scene, view, self.step_index),
            moving=() if self._traffic is None else moving_objects(self.scene, self._traffic.poses()),
        )

    def view_from(self, position_m: Float[np.ndarray, "2"], yaw_rad: float) -> StoredView:
        """What an atlas keeps of a pose. The robot stands there afterwards, which it knows nothing of.

        Args:
            position_m: a free place.
            yaw_rad: where to look; the tilt is that of the start of an episode.
        """
        self.scene.body.place(position_m, yaw_rad, self._config.robot.rest_tilt_rad)
        view = self.draw(*self._config.image_size, self._config.antialias, self._config.colours)
        seen = view.frame
        if not self._detector.needs_detail:
            return StoredView(seen.depth_m, seen.geom_id, np.zeros_like(seen.depth_m), ())
        sight = self.draw(*self._config.detector_size, antialias=True)
        return StoredView(seen.depth_m, seen.geom_id, sight.frame.depth_m, tuple(self._detect(sight)))

    def trace(self) -> AgentTrace:
        """What a picture from outside shows of the robot."""
        return AgentTrace(self.view.camera, tuple(self._places_m), tuple(self.robot.objects), self.robot.target)

    def _aim(self, yaw_pitch: Float[np.ndarray, "2"]) -> None:
        """Turns the camera: around the target's direction, or on from where it points."""
        body, target = self.scene.body, self.robot.target
        if target is None or self._config.gaze == "free":
            body.look(body.yaw_rad + yaw_pitch[0] * TURN_RAD, body.tilt_rad + yaw_pitch[1] * TILT_RAD)
            return
        offset = target.centroid_m - body.camera_to_world[:3, 3]
        yaw_rad = float(np.arctan2(offset[1], offset[0]))
        tilt_rad = float(np.arctan2(offset[2], np.hypot(offset[0], offset[1])))
        body.look(yaw_rad + yaw_offset_rad(yaw_pitch[0]), tilt_rad + yaw_pitch[1] * PITCH_RAD)

    def _look(self) -> MemoryUpdate:
        """Draws what the robot sees now or looks it up, detects, and lets it learn from that."""
        if self._atlas is None:
            self.view = self.draw(*self._config.image_size, self._config.antialias, self._config.colours)
            """What it sees."""
            self.sight = self.view
            """What its detector looks at."""
            if self._detector.needs_detail:
                self.sight = self.draw(*self._config.detector_size, antialias=True)
            self.detections = self._detect(self.sight)
            """What its detector says about that."""
        else:
            self._look_up(self._atlas)
        return self.robot.observe(
            self.detections,
            self.sight.frame.depth_m,
            self.sight.camera,
            self.view.frame.depth_m,
            self.view.camera,
            self.scene.body.yaw_rad,
        )

    def _look_up(self, atlas: SceneAtlas) -> None:
        """What the atlas holds of this pose. Pictures are black."""
        body = self.scene.body
        pose, poses = body.camera_to_world, atlas.poses
        stored = atlas.view(self._place, poses.nearest_heading(body.yaw_rad), self.step_index)
        instance_map = self.scene.instance_of_geom[stored.geom_id]
        camera = Camera.from_fov(pose, self._config.image_size, 0.5 * np.pi)
        self.view = View(Frame(_nothing(*camera.size)[0], stored.depth_m, stored.geom_id), instance_map, camera)
        if not self._detector.needs_detail:
            self.sight, self.detections = self.view, self._detect(self.view)
            return
        camera = Camera.from_fov(pose, self._config.detector_size, 0.5 * np.pi)
        black, no_geom, no_instance = _nothing(*camera.size)
        self.sight = View(Frame(black, stored.detector_depth_m, no_geom), no_instance, camera)
        self.detections = list(stored.detections)

    def _keep_to_places(self) -> None:
        """With an atlas: stands where the atlas has views from."""
        if self._atlas is not None:
            body, poses = self.scene.body, self._atlas.poses
            self._place = poses.nearest_place(body.position_m, self.scene.world.navigable)
            body.place(poses.places_m[self._place], body.yaw_rad, body.tilt_rad)

    def _keep_to_headings(self) -> None:
        """With an atlas: looks where the atlas has views to."""
        if self._atlas is not None:
            body, poses = self.scene.body, self._atlas.poses
            heading = poses.nearest_heading(body.yaw_rad)
            body.look(poses.heading_rad(heading), self._config.robot.rest_tilt_rad)

    def _detect(self, view: View) -> list[Detection]:
        """Detections in a view."""
        return self._detector.detect(self.scene, view, self.step_index, self._entropy)


def displacement_of(forward_left: Float[np.ndarray, "2"], yaw_rad: float, stride_m: float) -> Float[np.ndarray, "2"]:
    """World displacement of a move command, at most one stride long.

    Args:
        forward_left: the first two numbers of an action.
        yaw_rad: where the camera points before the move, counter-clockwise from +X.
        stride_m: longest move of one step.
    """
    forward, left = forward_left / max(1.0, float(np.linalg.norm(forward_left)))
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return stride_m * np.array([cos * forward - sin * left, sin * forward + cos * left])


def _object_model(detector: str) -> ObjectModel:
    """What looks of a detector say of objects."""
    return calibration_of(detector).objects


@functools.lru_cache(maxsize=4)
def _nothing(
    height_px: int, width_px: int
) -> tuple[UInt8[np.ndarray, "h w 3"], Int32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]]:
    """A black picture, and geom and instance ids of pixels that show nothing; nobody may write to them."""
    size = (height_px, width_px)
    arrays = np.zeros((*size, 3), np.uint8), np.full(size, -1, np.int32), np.zeros(size, np.int32)
    for array in arrays:
        array.flags.writeable = False
    return arrays
