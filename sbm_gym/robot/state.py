"""What a robot knows in the course of one episode: everything that ``RobotKnowledge`` promises to policies."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float

from labeling.core.types import Detection
from labeling.core.views import Camera
from labeling.generator.objects.object_posterior import ObjectModel
from sbm_gym.robot.angles import wrap
from sbm_gym.robot.body import BodyConfig
from sbm_gym.robot.line_of_sight import stop_short
from sbm_gym.robot.object_beliefs import ObjectBeliefs
from sbm_gym.robot.object_memory import Finding, KnownObject, MemoryConfig, MemoryUpdate, ObjectMemory
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.robot.view_history import ViewHistory
from sbm_gym.worlds.geometry.navigable import NavigableMap

RING_SHARES = (0.3, 0.8)
"""Where on the ring, from its inner to its outer edge, it is tried whether an object can be seen from there."""
REFIXATE_RAD = np.deg2rad(10.0)
"""A visible object so much nearer to the middle of the picture than the fixation target takes its place."""


@dataclass(frozen=True)
class RobotConfig:
    """What stays the same from episode to episode; the defaults are those of rooms."""

    body: BodyConfig = field(default_factory=BodyConfig)
    """The agent's body and the height of its camera."""
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    """When detections are one object."""
    stride_m: float = 0.5
    """Longest move of one step."""
    rest_tilt_rad: float = -0.25
    """Tilt of the camera at the start of an episode: a little down, where furniture is."""
    ring_m: tuple[float, float] = (1.0, 2.0)
    """Distances at which objects are circled (thesis 4.1: 1 to 2 m)."""
    ring_clearance_m: float = 0.0
    """The ring begins at least this far outside an object, as far as its extent is known."""
    search_distance_m: tuple[float, float] = (1.5, 100.0)
    """Another place to search from is at least and at most this far away, where there is one."""
    seen_cell_m: float = 0.1
    """Cell of the grid in which seen surfaces are remembered."""

    @property
    def step_s(self) -> float:
        """Time that passes in a step: as long as the longest move takes."""
        return self.stride_m / self.body.speed_m_s


class RobotState:
    """Gathers what the robot's senses tell, view by view: a ``RobotKnowledge``, where its attributes are described."""

    def __init__(
        self,
        config: RobotConfig,
        navigable: NavigableMap,
        start_m: Float[np.ndarray, "2"],
        num_views: int,
        object_model: Callable[[], ObjectModel],
    ) -> None:
        """Starts with the map alone.

        Args:
            config: settings.
            navigable: the map the robot navigates by.
            start_m: where it stands.
            num_views: steps of the episode.
            object_model: gives what looks of the detector say of objects, once that is asked for.
        """
        self.navigable = navigable
        self.stride_m, self.camera_height_m = config.stride_m, config.body.camera_height_m
        self.rest_tilt_rad, self.max_depth_m = config.rest_tilt_rad, config.memory.max_depth_m
        self.ring_m, self.ring_clearance_m = config.ring_m, config.ring_clearance_m
        self.search_distance_m, self.view_bins = config.search_distance_m, config.memory.bins
        self.view_history = ViewHistory(config.memory)
        self.seen_floor = SeenFloor(navigable, start_m, config.stride_m, config.memory.max_depth_m)
        size_m = np.array(navigable.free.shape[::-1]) * navigable.cell_m
        self.seen_space = SeenSpace(navigable.origin_m, navigable.origin_m + size_m, config.seen_cell_m)
        self._memory = ObjectMemory(config.memory)
        self._make_beliefs = lambda: ObjectBeliefs(object_model(), config.memory, num_views + 1)
        self._beliefs: ObjectBeliefs | None = None
        self._not_judged: list[tuple[Sequence[Finding], Float[np.ndarray, "h w"], Camera]] = []
        self._steps_left = num_views + 1
        self._target_id: int | None = None
        self._camera_to_world: Float[np.ndarray, "4 4"] = np.eye(4)

    def observe(
        self,
        detections: Sequence[Detection],
        detector_depth_m: Float[np.ndarray, "h w"],
        detector_camera: Camera,
        depth_m: Float[np.ndarray, "h2 w2"],
        camera: Camera,
        yaw_rad: float,
    ) -> MemoryUpdate:
        """Takes in one view.

        Args:
            detections: what the detector says about it.
            detector_depth_m: z-depth of the picture that the detector was given, 0 = no return.
            detector_camera: of that picture; its pose is from odometry.
            depth_m: z-depth of the observed picture.
            camera: of that picture, at the same pose.
            yaw_rad: where the camera points.

        Returns:
            What is new.
        """
        self._camera_to_world = camera.camera_to_world
        self._steps_left -= 1
        update = self._memory.observe(detections, detector_depth_m, detector_camera)
        self._not_judged.append((update.findings, detector_depth_m, detector_camera))
        self.view_history.add(update.unconfirmed, self.objects, camera.camera_to_world)
        self.seen_floor.add(depth_m, camera)
        self.seen_space.add(depth_m, camera)
        self._refixate(update.visible, yaw_rad)
        return update

    @property
    def views_left(self) -> int:
        """Steps until the episode ends."""
        return max(0, self._steps_left)

    @property
    def objects(self) -> list[KnownObject]:
        """The confirmed objects."""
        return self._memory.objects

    @property
    def target(self) -> KnownObject | None:
        """The object that it fixates."""
        return None if self._target_id is None else self.objects[self._target_id]

    @property
    def beliefs(self) -> ObjectBeliefs:
        """What all looks say of everything that the detector has pointed at; worked out when asked for."""
        if self._beliefs is None:
            self._beliefs = self._make_beliefs()
        for view in self._not_judged:
            self._beliefs.add(*view)
        self._not_judged.clear()
        return self._beliefs

    def fixate(self, object_id: int) -> None:
        """Makes another confirmed object the fixation target, from the next step on.

        Raises:
            ValueError: if no object with this id has been confirmed.
        """
        if not 0 <= object_id < len(self.objects):
            raise ValueError(f"no confirmed object {object_id}; there are {len(self.objects)}, counted from 0")
        self._target_id = object_id

    # For observations -------------------------------------------------------------------------------------------------

    def open_sectors(self, known: KnownObject) -> Bool[np.ndarray, "sectors"]:
        """From which sectors around an object it could be seen, as far as the robot knows.

        Those with a place in their middle, at one of two distances of the ring, where the robot can stand and from
        where no surface that it has seen hides the object.
        """
        offsets_m = _ring_offsets_m(self.view_bins.num_azimuths, *self.ring_m)
        stop_short_m = stop_short(float(np.max(known.extent_m)))
        height_m = float(self._camera_to_world[2, 3])
        return self.seen_space.open_directions(known.centroid_m, offsets_m, self.navigable, height_m, stop_short_m)

    # Parts of the above -----------------------------------------------------------------------------------------------

    def _refixate(self, visible: tuple[int, ...], yaw_rad: float) -> None:
        """Whatever the robot looks straight at becomes its fixation target; so does the first object it finds."""
        target = self.target
        if target is None:
            self._target_id = 0 if self.objects else None
            return
        off_rad = {known_id: self._off_centre_rad(self.objects[known_id], yaw_rad) for known_id in visible}
        nearest = min(off_rad, key=lambda known_id: off_rad[known_id], default=None)
        if nearest is not None and off_rad[nearest] < self._off_centre_rad(target, yaw_rad) - REFIXATE_RAD:
            self._target_id = nearest

    def _off_centre_rad(self, known: KnownObject, yaw_rad: float) -> float:
        """How far to the side of where the camera points an object is."""
        offset = known.centroid_m - self._camera_to_world[:3, 3]
        side_rad = float(np.arctan2(offset[1], offset[0])) - yaw_rad
        return abs(wrap(side_rad))


@lru_cache(maxsize=16)
def _ring_offsets_m(count: int, low_m: float, high_m: float) -> Float[np.ndarray, "shares count 2"]:
    """Places in the middle of sectors around an object, from the object."""
    angles = (np.arange(count) + 0.5) * (2.0 * np.pi / count)
    distances_m = low_m + (high_m - low_m) * np.array(RING_SHARES)
    return distances_m[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
