"""Recordings of one furnished room with ten objects and any number of views, for the benchmarks of labelling."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int32

from labeling.core.episode import Episode
from labeling.core.geometry import look_at
from labeling.core.views import Camera
from sbm_gym.detection.simulated import SimulatedDetector, SimulatedView
from sbm_gym.env.recording import Capture, episode_of_captures, ground_truth_of_view
from sbm_gym.env.view_detectors import View
from sbm_gym.scenes.compiled import Scene, compile_scene
from sbm_gym.scenes.world_sources import world_source
from sbm_gym.worlds.world import ObjectInstance

SCENE = "train/12"
NUM_OBJECTS = 10
SIZE = (240, 320)
EYE_M = 1.5
"""Height of the camera above the floor."""
DISTANCE_M = 2.0
"""From the middle of the object looked at, where there is room to stand."""
WELL_SEEN = 0.03
"""Share of the picture that the object looked at must fill."""
PROBE_SIZE = (48, 64)
MAX_TURNS = 24
_GOLDEN_RAD = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True)
class Room:
    """The scene, and those of its objects that recordings of it are about."""

    scene: Scene
    objects: tuple[ObjectInstance, ...]

    def picture(self, pose: Float[np.ndarray, "4 4"], size: tuple[int, int], antialias: bool = True):
        """Frame, camera, and instance ids of the objects that count (0 elsewhere)."""
        camera = Camera.from_fov(pose, size, 0.5 * np.pi)
        frame = self.scene.renderer.render(self.scene.data, camera, antialias=antialias)
        instance: Int32[np.ndarray, "h w"] = self.scene.instance_of_geom[frame.geom_id]
        instance = np.where(np.isin(instance, [one.instance_id for one in self.objects]), instance, 0)
        return frame, camera, instance


def open_room() -> Room:
    """The room, ready to be drawn: the ten objects, of categories the detector knows, that stand closest together."""
    source = world_source("indoor")
    scene = compile_scene(SCENE, source.build(SCENE), "rays", source.profile.body)
    known = [one for one in scene.world.objects if one.category in SimulatedDetector().config.categories]
    centres = np.stack([one.box_3d.centre_m[:2] for one in known])
    distance = np.linalg.norm(centres[:, None] - centres[None], axis=2)
    middle = int(np.sort(distance, axis=1)[:, NUM_OBJECTS - 1].argmin())
    nearest = np.argsort(distance[middle], kind="stable")[:NUM_OBJECTS]
    return Room(scene, tuple(known[index] for index in nearest))


def record(room: Room, num_views: int, num_true: int) -> Episode:
    """Looks at the ten objects in turn, each time from another side.

    Simulated detector (its defaults) and ground truth know these ten objects only.

    Args:
        room: where.
        num_views: how many views; the first of them do not depend on it.
        num_true: so many of the first views have ground truth, which takes longer than everything else.
    """
    scene, detector = room.scene, SimulatedDetector()
    scene = replace(scene, world=replace(scene.world, objects=room.objects))
    captures = []
    for view in range(num_views):
        pose = _viewpoint(room, view)
        frame, camera, instance = room.picture(pose, SIZE)
        truths = ()
        if view < num_true:
            truths = ground_truth_of_view(scene, View(frame, instance, camera), view)
        observed = tuple(scene.surfaces.observe(instance, camera))
        found = detector.detect(
            np.random.default_rng([0, view]), SimulatedView(view, instance, frame.depth_m, observed)
        )
        captures.append(Capture(frame.rgb, frame.depth_m, camera.intrinsics, pose, tuple(found), truths))
    return episode_of_captures(captures, detector.config.categories, {"scene": SCENE})


def first_views(episode: Episode, count: int) -> Episode:
    """The episode as if it had ended after so many views."""
    of_views = ("rgb", "depth_m", "intrinsics", "camera_to_world", "file_names")
    return replace(
        episode,
        **{name: getattr(episode, name)[:count] for name in of_views},
        detections=tuple(one for one in episode.detections or () if one.view_index < count),
        ground_truth=tuple(one for one in episode.ground_truth or () if one.view_index < count),
    )


def _viewpoint(room: Room, view: int) -> Float[np.ndarray, "4 4"]:
    """A camera that sees the object whose turn it is well, or best of those tried."""
    one = room.objects[view % NUM_OBJECTS]
    target, best, best_px = one.box_3d.centre_m, None, -1
    for turn in range(MAX_TURNS):
        angle = _GOLDEN_RAD * (view + 7 * turn)
        place = target[:2] + DISTANCE_M * np.array([np.cos(angle), np.sin(angle)])
        pose = look_at(np.array([*room.scene.world.navigable.nearest_free(place), EYE_M]), target)
        shown = np.count_nonzero(room.picture(pose, PROBE_SIZE, antialias=False)[2] == one.instance_id)
        if shown > best_px:
            best, best_px = pose, shown
        if shown >= WELL_SEEN * PROBE_SIZE[0] * PROBE_SIZE[1]:
            break
    assert best is not None
    return best
