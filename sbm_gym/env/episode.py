"""One episode: a robot in a scene that moves, looks, detects and remembers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.geometry import intrinsics_from_fov
from labeling.core.types import Detection
from sbm_gym.env.gaze import PITCH_RAD, yaw_offset_rad
from sbm_gym.env.recording import Capture, ground_truth_of_view
from sbm_gym.env.view_detectors import View, ViewDetector
from sbm_gym.rendering.third_person import AgentTrace, Find
from sbm_gym.robot.object_memory import KnownObject, MemoryConfig, MemoryUpdate, ObjectMemory
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.robot.view_history import LookedAt
from sbm_gym.scenes.compiled import Scene

GAZES = ("fixate", "free")
TURN_RAD, TILT_RAD = np.deg2rad(60.0), np.deg2rad(30.0)
"""What gaze actions of 1 turn and tilt the camera by, without a fixation target."""
OPEN_AT = (0.3, 0.8)
"""Where on the ring, from its inner to its outer edge, it is tried whether an object can be seen from there."""
REFIXATE_RAD = np.deg2rad(10.0)
"""A visible object so much nearer to the middle of the picture than the fixation target takes its place."""


@dataclass(frozen=True)
class EpisodeSettings:
    """What stays the same from episode to episode."""

    memory: MemoryConfig
    image_size: tuple[int, int]
    """Height and width of what the robot sees at every step, pixels."""
    antialias: bool
    colours: bool
    """Whether what the robot sees at every step has colours."""
    detector_size: tuple[int, int]
    """Height and width of what a detector that needs detail looks at, pixels; with smooth edges."""
    stride_m: float
    ring_m: tuple[float, float]
    """Distances at which objects are circled."""
    seen_cell_m: float
    """Cell of the grid in which seen surfaces are remembered."""
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
        self.looked = LookedAt(settings.memory)
        """Where it has looked, and what may be an object."""
        self.floor = SeenFloor(scene.world.navigable, position_m, settings.stride_m, settings.memory.max_depth_m)
        """Which part of the floor it has seen."""
        navigable = scene.world.navigable
        size_m = np.array(navigable.free.shape[::-1]) * navigable.cell_m
        self.space = SeenSpace(navigable.origin_m, navigable.origin_m + size_m, settings.seen_cell_m)
        """Which surfaces it has seen."""
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

    def draw(self, height_px: int, width_px: int, antialias: bool, colours: bool = True) -> View:
        """What the camera sees now; the field of view is 90 degrees across."""
        intrinsics = intrinsics_from_fov(width_px, height_px, 0.5 * np.pi)
        frame = self.scene.renderer.render(
            self.scene.data,
            intrinsics,
            self.scene.body.camera_to_world,
            height_px,
            width_px,
            antialias=antialias,
            colours=colours,
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
        body.look(yaw_rad + yaw_offset_rad(yaw_pitch[0]), tilt_rad + yaw_pitch[1] * PITCH_RAD)

    def _look(self) -> MemoryUpdate:
        """Draws what the robot sees now, detects, and lets the memory learn from it."""
        self.view = self.draw(*self._settings.image_size, self._settings.antialias, self._settings.colours)
        """What it sees."""
        self.sight = self.view
        """What its detector looks at."""
        if self._detector.needs_detail:
            self.sight = self.draw(*self._settings.detector_size, antialias=True)
        self.detections = self._detect(self.sight)
        """What its detector says about that."""
        sight, pose = self.sight, self.scene.body.camera_to_world
        update = self.memory.observe(self.detections, sight.frame.depth_m, sight.intrinsics, pose)
        self.looked.add(update.doubtful, self.memory.objects, pose)
        self.floor.add(self.view.frame.depth_m, self.view.intrinsics, pose)
        self.space.add(self.view.frame.depth_m, self.view.intrinsics, pose)
        self._refixate(update.visible)
        return update

    def open_sectors(self, known: KnownObject) -> Bool[np.ndarray, "sectors"]:
        """From which sectors around an object it could be seen, as far as the robot knows.

        Those with a place in their middle, at one of two distances of the ring, where the robot can stand and from
        where no surface that it has seen hides the object.
        """
        count = self._settings.memory.bins.num_azimuths
        angles = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
        low_m, high_m = self._settings.ring_m
        distances_m = low_m + (high_m - low_m) * np.array(OPEN_AT)
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        places = known.centroid_m[:2] + distances_m[:, None, None] * directions
        free = self.scene.world.navigable.are_free(places)
        seen = np.zeros_like(free)
        height_m = float(self.scene.body.camera_to_world[2, 3])
        eyes = np.concatenate([places[free], np.full((np.count_nonzero(free), 1), height_m)], axis=1)
        seen[free] = self.space.sees(eyes, known.centroid_m, 0.25 + 0.5 * float(np.max(known.extent_m)))
        return np.asarray(seen.any(axis=0))

    def _refixate(self, visible: tuple[int, ...]) -> None:
        """Whatever the robot looks straight at becomes its fixation target; so does the first object it finds."""
        target = self.target
        if target is None:
            self.target_id = 0 if self.memory.objects else None
            return
        off_rad = {known_id: self._off_centre_rad(self.memory.objects[known_id]) for known_id in visible}
        nearest = min(off_rad, key=lambda known_id: off_rad[known_id], default=None)
        if nearest is not None and off_rad[nearest] < self._off_centre_rad(target) - REFIXATE_RAD:
            self.target_id = nearest

    def _off_centre_rad(self, known: KnownObject) -> float:
        """How far to the side of where the camera points an object is."""
        body = self.scene.body
        offset = known.centroid_m - body.camera_to_world[:3, 3]
        side_rad = float(np.arctan2(offset[1], offset[0])) - body.yaw_rad
        return abs((side_rad + np.pi) % (2.0 * np.pi) - np.pi)

    def _detect(self, view: View) -> list[Detection]:
        """Detections in a view."""
        return self._detector.detect(self.scene, view, self.step_index, self._entropy)
