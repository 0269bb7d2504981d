"""Taking photographs of a set, with the mask of every object that an annotator would see."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Bool, Int32, UInt8

from labeling.core.types import Box3d
from labeling.core.views import Camera
from sbm_gym.detection.visibility import ObjectSurfaces
from sbm_gym.photographs.camera import draw_camera
from sbm_gym.photographs.sets import PhotoScene
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.worlds.world import ObjectInstance

SMALLEST_SHARE = 0.0015
"""Annotators leave out what takes a smaller share of the picture: 7 by 8 pixels of 192 by 192 ..."""
LEAST_VISIBLE = 0.08
"""... and objects of which less than this can be seen."""
SUBJECT_VISIBLE, SUBJECT_CUT = 0.72, 0.12
"""Share of a subject that must not be hidden, and that may lie outside the picture."""
NEARER = 0.55
"""What is this much nearer than the subject stands in the way ..."""
IN_THE_WAY = 0.18
"""... unless it takes less than this share of the picture."""
TRIES = 14
PREVIEW_PX = 48
_SHAPES = ((1.0, 1.0), (1.0, 1.0), (0.833, 1.167), (1.167, 0.833))
"""Height and width of pictures in sizes: half of them square, the others landscape or portrait."""
_WEIGHT = {"chair": 0.5, "table": 0.8, "car": 0.7, "plant": 1.0, "couch": 1.0}
"""How often an object of a class is a subject where others are there too; classes that keep no company have 2."""


@dataclass(frozen=True)
class Annotation:
    """One object in one photograph."""

    category: str
    model_name: str
    mask: Bool[np.ndarray, "h w"]
    ignore: bool
    """Whether an annotator would have left it out: neither rewarded nor punished."""


@dataclass(frozen=True)
class Photograph:
    """One picture and what is in it."""

    rgb: UInt8[np.ndarray, "h w 3"]
    annotations: tuple[Annotation, ...]


def take_photographs(photo_set: PhotoScene, count: int, size_px: int, rng: np.random.Generator) -> list[Photograph]:
    """Takes photographs of a set.

    Args:
        photo_set: what to photograph.
        count: how many; fewer come back where subjects have no free view.
        size_px: side of a square picture; others have as many pixels.
        rng: source of randomness.
    """
    if not photo_set.pieces.subjects:
        return []
    view = Viewfinder(photo_set)
    cameras = (view.find(size_px, rng) for _ in range(count))
    return [view.take(camera) for camera in cameras if camera is not None]


class Viewfinder:
    """A compiled set and its renderer."""

    def __init__(self, photo_set: PhotoScene):
        """Compiles ``photo_set``."""
        self.photo_set = photo_set
        scene = photo_set.pieces.scene
        self.model = scene.spec.compile()
        looks = scene.left_out.looks(self.model)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self.renderer = RaysRenderer(self.model, looks=looks)
        objects = photo_set.pieces.objects
        self.surfaces = ObjectSurfaces.sampled(self.model, self.data, objects, photo_set.name, looks=looks)
        instance_of_body = np.zeros(self.model.nbody, np.int32)
        for instance in objects:
            instance_of_body[self.model.body(instance.body_name).id] = instance.instance_id
        # The last entry, which index -1 (no geom) picks, is 0.
        self.instance_of_geom = np.append(instance_of_body[self.model.geom_bodyid], np.int32(0))

    def find(self, size_px: int, rng: np.random.Generator) -> Camera | None:
        """A view in which its subjects are seen well; None if none was found."""
        subjects = self.photo_set.pieces.subjects
        weights = np.array([_WEIGHT.get(subject.category, 2.0) for subject in subjects])
        for _ in range(TRIES):
            chosen = [subjects[int(rng.choice(len(subjects), p=weights / weights.sum()))]]
            if rng.random() < 0.3:
                chosen += _neighbour(chosen[0], subjects)
            tall, wide = _SHAPES[int(rng.integers(len(_SHAPES)))]
            size = (round(size_px * tall), round(size_px * wide))
            camera = draw_camera(self.photo_set, _around(chosen), size, rng)
            if camera is not None and self._is_clear(camera, chosen):
                return camera
        return None

    def take(self, camera: Camera) -> Photograph:
        """The picture and its annotations."""
        frame = self.renderer.render(self.data, camera)
        instances: Int32[np.ndarray, "h w"] = self.instance_of_geom[frame.geom_id]
        observed = self.surfaces.observe(instances, camera)
        seen = {entry.instance_id: entry.visible_share * (1.0 - entry.truncated_share) for entry in observed}
        annotations = []
        for instance in self.photo_set.pieces.objects:
            mask = instances == instance.instance_id
            if area := np.count_nonzero(mask):
                ignore = area < SMALLEST_SHARE * mask.size or seen.get(instance.instance_id, 0.0) < LEAST_VISIBLE
                annotations.append(Annotation(instance.category, instance.model_name, mask, bool(ignore)))
        return Photograph(frame.rgb, tuple(annotations))

    def _is_clear(self, camera: Camera, chosen: Sequence[ObjectInstance]) -> bool:
        """Looks at a small preview: are the subjects there, whole and not hidden, with nothing big before them?"""
        scale = PREVIEW_PX / camera.size[1]
        intrinsics = camera.intrinsics * np.array([[scale], [scale], [1.0]])
        small = replace(camera, intrinsics=intrinsics, size=(round(camera.size[0] * scale), PREVIEW_PX))
        frame = self.renderer.render(self.data, small, antialias=False)
        instances = self.instance_of_geom[frame.geom_id]
        observed = self.surfaces.observe(instances, small)
        ids = [subject.instance_id for subject in chosen]
        found = [entry for entry in observed if entry.instance_id in ids]
        whole = all(e.visible_share >= SUBJECT_VISIBLE and e.truncated_share <= SUBJECT_CUT for e in found)
        if len(found) < len(chosen) or not whole:
            return False
        away = min(entry.range_m for entry in found)
        # The floor before one's feet is no obstacle.
        lower = np.arange(small.size[0])[:, None] > 0.7 * small.size[0]
        near = (frame.depth_m > 0) & (frame.depth_m < NEARER * away) & ~np.isin(instances, ids) & ~lower
        return bool(near.mean() < IN_THE_WAY)


def _neighbour(subject: ObjectInstance, others: Sequence[ObjectInstance]) -> list[ObjectInstance]:
    """The nearest other subject, if it stands so near that one picture shows both."""
    reach = 1.2 * float(np.linalg.norm(subject.box_3d.extent_m[:2])) + 1.0

    def away(other: ObjectInstance) -> float:
        return float(np.linalg.norm(other.box_3d.centre_m - subject.box_3d.centre_m))

    near = sorted((other for other in others if other is not subject and away(other) < reach), key=away)
    return near[:1]


def _around(chosen: Sequence[ObjectInstance]) -> Box3d:
    """A box in the axes of the first subject around all of them."""
    boxes = [instance.box_3d for instance in chosen]
    first = boxes[0]
    if len(boxes) == 1:
        return first
    signs = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    corners = [box.centre_m + (signs * box.extent_m) @ np.asarray(box.rotation).T for box in boxes]
    local = np.concatenate(corners) @ first.rotation
    low, high = local.min(axis=0), local.max(axis=0)
    return Box3d(first.rotation @ (0.5 * (low + high)), high - low, first.rotation)
