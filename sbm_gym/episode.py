"""One episode: a robot in a scene that moves, looks, detects and remembers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from labeling.geometry import intrinsics_from_fov
from labeling.instances import Detection
from sbm_gym.object_memory import KnownObject, MemoryConfig, MemoryUpdate, ObjectMemory
from sbm_gym.recording import Capture, ground_truth_of_view
from sbm_gym.rendering.third_person import AgentTrace, Find
from sbm_gym.scenes import Scene
from sbm_gym.view_detectors import View, ViewDetector

GAZES = ("fixate", "free")
TURN_RAD, TILT_RAD = np.deg2rad(60.0), np.deg2rad(30.0)
"""What gaze actions of 1 turn and tilt the camera by, without a fixation target."""
OFFSET_RAD = np.deg2rad(45.0)
"""How far from its fixation target gaze actions of 1 point the camera."""


@dataclass(frozen=True)
class EpisodeSettings:
    """What stays the same from episode to episode."""

    memory: MemoryConfig
    image_size: tuple[int, int]
    """Height and width of what the robot sees at every step, pixels."""
    antialias: bool
    detector_size: tuple[int, int]
    """Height and width of what a detector that needs detail looks at, pixels; with smooth edges."""
    stride_m: float
    gaze: str
    """One of ``GAZES``."""


class Episode:
    """The robot's state in a scene, from its first look on."""

    def __init__(
        self,
        scene: Scene,
        settings: EpisodeSettings,
        detector: ViewDetector,
        entropy: int,
        position_m: Float[np.ndarray, "2"],
        yaw_rad: float,
        tilt_rad: float,
    ) -> None:
        """Puts the robot down and has it look.

        Args:
            scene: as this episode finds it.
            settings: of the environment.
            detector: detects in what it sees.
            entropy: seeds the detector's noise.
            position_m: where it starts.
            yaw_rad: its heading.
            tilt_rad: of its camera, up is positive.
        """
        self.scene, self._settings, self._detector, self._entropy = scene, settings, detector, entropy
        self.memory = ObjectMemory(settings.memory)
        """What the robot knows about objects."""
        self.target_id: int | None = None
        """The object it fixates."""
        self.step_index, self.collided, self.path_m = 0, False, 0.0
        scene.body.place(position_m, yaw_rad, tilt_rad)
        self._places_m = [position_m]
        self.update = self._look()
        """What the last look taught it."""

    @property
    def target(self) -> KnownObject | None:
        """The object it fixates, None before any is confirmed."""
        return None if self.target_id is None else self.memory.objects[self.target_id]

    def act(self, action: Float[np.ndarray, "4"]) -> None:
        """Moves, turns the camera, looks.

        Args:
            action: forward, left, gaze yaw and gaze pitch, each in [-1, 1].
        """
        body = self.scene.body
        before = body.position_m
        displacement_m = self._displacement_m(action[:2], body.yaw_rad)
        way_is_free = self.scene.world.navigable.line_is_free(before, before + displacement_m)
        self.collided = body.move(displacement_m, way_is_free=way_is_free).collided
        self.path_m += float(np.linalg.norm(body.position_m - before))
        self._places_m.append(body.position_m)
        self._aim(action[2:])
        self.step_index += 1
        self.update = self._look()

    def fixate(self, object_id: int) -> None:
        """Makes another confirmed object the fixation target, from the next step on.

        Raises:
            ValueError: if no object with this id has been confirmed.
        """
        if not 0 <= object_id < len(self.memory.objects):
            raise ValueError(f"no confirmed object {object_id}; there are {len(self.memory.objects)}, counted from 0")
        self.target_id = object_id

    def draw(self, height_px: int, width_px: int, antialias: bool) -> View:
        """What the camera sees now; the field of view is 90 degrees across."""
        intrinsics = intrinsics_from_fov(width_px, height_px, 0.5 * np.pi)
        frame = self.scene.renderer.render(
            self.scene.data, intrinsics, self.scene.body.camera_to_world, height_px, width_px, antialias=antialias
        )
        return View(frame, self.scene.instance_of_geom[frame.geom_id], intrinsics)

    def capture(self, height_px: int, width_px: int) -> Capture:
        """A full frame of the current view. Changes nothing."""
        scene, camera_to_world = self.scene, self.scene.body.camera_to_world
        if self._detector.needs_detail and self._settings.detector_size == (height_px, width_px):
            view, detections = self.sight, self.detections
        else:
            view = self.draw(height_px, width_px, antialias=True)
            detections = self._detect(view)
        return Capture(
            rgb=view.frame.rgb,
            depth_m=view.frame.depth_m,
            intrinsics=view.intrinsics,
            camera_to_world=camera_to_world,
            detections=tuple(detections),
            ground_truth=ground_truth_of_view(
                scene.world,
                scene.renderer,
                scene.data,
                view.instance_map,
                scene.geoms_of_instance,
                view.intrinsics,
                camera_to_world,
                self.step_index,
            ),
        )

    def trace(self) -> AgentTrace:
        """What a picture from outside shows of the robot."""
        return AgentTrace(
            camera_to_world=self.scene.body.camera_to_world,
            intrinsics=self.view.intrinsics,
            picture_size_px=self._settings.image_size,
            path_m=tuple(self._places_m),
            finds=tuple(
                Find(
                    known.centroid_m,
                    float(np.max(known.extent_m)),
                    f"{known.category} {known.best_confidence:.2f}",
                    known.object_id == self.target_id,
                )
                for known in self.memory.objects
            ),
        )

    def _displacement_m(self, forward_left: Float[np.ndarray, "2"], yaw_rad: float) -> Float[np.ndarray, "2"]:
        """World displacement of a move command, at most one stride long."""
        forward, left = forward_left / max(1.0, float(np.linalg.norm(forward_left)))
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        return self._settings.stride_m * np.array([cos * forward - sin * left, sin * forward + cos * left])

    def _aim(self, yaw_pitch: Float[np.ndarray, "2"]) -> None:
        """Turns the camera: around the target's direction, or on from where it points."""
        body, target = self.scene.body, self.target
        if target is None or self._settings.gaze == "free":
            body.look(body.yaw_rad + yaw_pitch[0] * TURN_RAD, body.tilt_rad + yaw_pitch[1] * TILT_RAD)
            return
        offset = target.centroid_m - body.camera_to_world[:3, 3]
        yaw_rad = float(np.arctan2(offset[1], offset[0]))
        tilt_rad = float(np.arctan2(offset[2], np.hypot(offset[0], offset[1])))
        body.look(yaw_rad + yaw_pitch[0] * OFFSET_RAD, tilt_rad + yaw_pitch[1] * OFFSET_RAD)

    def _look(self) -> MemoryUpdate:
        """Draws what the robot sees now, detects, and lets the memory learn from it."""
        self.view = self.draw(*self._settings.image_size, antialias=self._settings.antialias)
        """What it sees."""
        self.sight = self.view
        """What its detector looks at."""
        if self._detector.needs_detail:
            self.sight = self.draw(*self._settings.detector_size, antialias=True)
        self.detections = self._detect(self.sight)
        """What its detector says about that."""
        update = self.memory.observe(
            self.detections, self.sight.frame.depth_m, self.sight.intrinsics, self.scene.body.camera_to_world
        )
        if self.target_id is None and self.memory.objects:
            self.target_id = 0
        return update

    def _detect(self, view: View) -> list[Detection]:
        """Detections in a view."""
        return self._detector.detect(self.scene, view, self.step_index, self._entropy)
