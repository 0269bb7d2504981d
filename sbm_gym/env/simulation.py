"""The simulation of one episode: a robot in a scene that moves, looks and detects."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.env.gaze import PITCH_RAD, TILT_RAD, TURN_RAD, yaw_offset_rad
from sbm_gym.env.recording import Capture, ground_truth_of_view
from sbm_gym.env.view_detectors import View, ViewDetector
from sbm_gym.robot.object_memory import MemoryUpdate
from sbm_gym.robot.state import RobotConfig, RobotState
from sbm_gym.scenes.compiled import Scene
from sbm_gym.scenes.third_person import AgentTrace

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
        """
        self.scene, self._config, self._detector, self._entropy = scene, config, detector, entropy
        self.robot = RobotState(config.robot, scene.world.navigable, position_m, num_views)
        """What the robot knows."""
        self.num_views, self.step_index, self.collided, self.path_m = num_views, 0, False, 0.0
        scene.body.place(position_m, yaw_rad, config.robot.rest_tilt_rad)
        self._places_m = [position_m]
        self.update = self._look()
        """What the last look taught it."""

    def act(self, action: Float[np.ndarray, "4"]) -> None:
        """Moves, turns the camera, looks.

        Args:
            action: forward, left, gaze yaw and gaze pitch, each in [-1, 1].
        """
        body = self.scene.body
        before = body.position_m
        displacement_m = self._displacement_m(action[:2], body.yaw_rad)
        way_is_free = self.scene.world.navigable.line_is_free(before, before + displacement_m)
        self.collided = body.move(displacement_m, way_is_free=way_is_free)
        self.path_m += float(np.linalg.norm(body.position_m - before))
        self._places_m.append(body.position_m)
        self._aim(action[2:])
        self.step_index += 1
        self.update = self._look()

    def draw(self, height_px: int, width_px: int, antialias: bool, colours: bool = True) -> View:
        """What the camera sees now; the field of view is 90 degrees across."""
        camera = Camera.from_fov(self.scene.body.camera_to_world, (height_px, width_px), 0.5 * np.pi)
        frame = self.scene.renderer.render(self.scene.data, camera, antialias=antialias, colours=colours)
        return View(frame, self.scene.instance_of_geom[frame.geom_id], camera)

    def capture(self, height_px: int, width_px: int) -> Capture:
        """A full frame of the current view. Changes nothing."""
        if self._detector.needs_detail and self._config.detector_size == (height_px, width_px):
            view, detections = self.sight, self.detections
        else:
            view = self.draw(height_px, width_px, antialias=True)
            detections = self._detect(view)
        return Capture(
            rgb=view.frame.rgb,
            depth_m=view.frame.depth_m,
            intrinsics=view.camera.intrinsics,
            camera_to_world=view.camera.camera_to_world,
            detections=tuple(detections),
            ground_truth=ground_truth_of_view(self.scene, view, self.step_index),
        )

    def trace(self) -> AgentTrace:
        """What a picture from outside shows of the robot."""
        return AgentTrace(self.view.camera, tuple(self._places_m), tuple(self.robot.objects), self.robot.target)

    def _displacement_m(self, forward_left: Float[np.ndarray, "2"], yaw_rad: float) -> Float[np.ndarray, "2"]:
        """World displacement of a move command, at most one stride long."""
        forward, left = forward_left / max(1.0, float(np.linalg.norm(forward_left)))
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        return self._config.robot.stride_m * np.array([cos * forward - sin * left, sin * forward + cos * left])

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
        """Draws what the robot sees now, detects, and lets it learn from that."""
        self.view = self.draw(*self._config.image_size, self._config.antialias, self._config.colours)
        """What it sees."""
        self.sight = self.view
        """What its detector looks at."""
        if self._detector.needs_detail:
            self.sight = self.draw(*self._config.detector_size, antialias=True)
        self.detections = self._detect(self.sight)
        """What its detector says about that."""
        return self.robot.observe(
            self.detections,
            self.sight.frame.depth_m,
            self.sight.camera,
            self.view.frame.depth_m,
            self.view.camera,
            self.scene.body.yaw_rad,
        )

    def _detect(self, view: View) -> list[Detection]:
        """Detections in a view."""
        return self._detector.detect(self.scene, view, self.step_index, self._entropy)
