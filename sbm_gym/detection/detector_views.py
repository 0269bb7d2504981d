"""What a real detector says of objects and of background in random views, beside what the simulator knows of these."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import gymnasium as gym
import numpy as np
from jaxtyping import Bool, Int

from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.detection.lasting_phantoms import LastingPhantoms, background_cells
from sbm_gym.detection.visibility import ObservedObject

SAME_IOU = 0.4
"""A detection is of an object if their masks overlap so far."""
HEADINGS_RAD = (0.0, 0.35, -0.35)
"""Views at each place, as turns from a heading that is drawn: near ones tell noise per pose from what is smooth."""


@dataclass(frozen=True)
class ObjectView:
    """An object in a view."""

    place: int
    """Number of the place where the view was taken."""
    observed: ObservedObject
    area_share: float
    """Share of the picture that shows it."""
    right: float
    """Confidence of the surest detection of it with its category, 0 if there is none."""
    wrong: float
    """Of the surest detection of it with another category."""


@dataclass(frozen=True)
class CellView:
    """A part of a scene that is no object, in a view."""

    cell: str
    """Names it in all views."""
    area_share: float
    """Share of the picture that shows it."""
    confidence: float
    """Of the surest detection of it, 0 if there is none."""
    category: str
    """Of that detection; empty if there is none."""


@dataclass(frozen=True)
class DetectorViews:
    """Everything that random views show."""

    objects: tuple[ObjectView, ...]
    cells: tuple[CellView, ...]
    count: int
    """Number of views."""


def detector_views(env: gym.Env, places: int, seed: int, phantoms: LastingPhantoms) -> Iterator[DetectorViews]:
    """Looks about at random places of an environment's scenes, one after the other.

    Args:
        env: whose detector is a real one; all its scenes are used in turn.
        places: so many in all; three views are taken at each.
        seed: decides places and headings.
        phantoms: its cells and heights divide the background.

    Yields:
        What the views of one place show.
    """
    rng = np.random.default_rng(seed)
    names = env.get_wrapper_attr("scene_names")
    each = -(-places // len(names))
    for place in range(places):
        if place % each == 0:
            env.reset(seed=seed + place, options={"scene": names[place // each]})
        position_m = env.get_wrapper_attr("knowledge").navigable.random_point(rng)
        yaw_rad = rng.uniform(-np.pi, np.pi)
        views = [_view(env, position_m, yaw_rad + turn_rad, place, phantoms) for turn_rad in HEADINGS_RAD]
        objects = tuple(one for view in views for one in view.objects)
        yield DetectorViews(objects, tuple(one for view in views for one in view.cells), len(views))


def _view(env: gym.Env, position_m, yaw_rad: float, place: int, phantoms: LastingPhantoms) -> DetectorViews:
    scene = env.get_wrapper_attr("scene")
    seen = env.get_wrapper_attr("simulation").view_from(position_m, yaw_rad)
    instance_map = scene.instance_of_geom[seen.geom_id]
    camera = Camera.from_fov(scene.body.camera_to_world, instance_map.shape, 0.5 * np.pi)
    masks = [_resized(one.mask, instance_map.shape) for one in seen.detections]
    of_objects: dict[int, list[Detection]] = {}
    of_nothing: list[tuple[Detection, Bool[np.ndarray, "h w"]]] = []
    for detection, mask in zip(seen.detections, masks, strict=True):
        instance = _shown_by(mask, instance_map)
        if instance:
            of_objects.setdefault(instance, []).append(detection)
        elif mask.any() and (instance_map[mask] == 0).mean() > 0.5:
            of_nothing.append((detection, mask))
    objects = []
    for one in scene.surfaces.observe(instance_map, camera):
        of_it = of_objects.get(one.instance_id, [])
        right = max((d.confidence for d in of_it if d.category == one.category), default=0.0)
        wrong = max((d.confidence for d in of_it if d.category != one.category), default=0.0)
        objects.append(ObjectView(place, one, float((instance_map == one.instance_id).mean()), right, wrong))
    cells = dict(background_cells(seen.depth_m, instance_map, camera, phantoms.cell_m, phantoms.heights_m, 0))
    surest: dict[tuple[int, int, int], Detection] = {}
    for detection, mask in of_nothing:
        number = max(cells, key=lambda number: np.count_nonzero(cells[number] & mask), default=None)
        if number is not None and (number not in surest or detection.confidence > surest[number].confidence):
            surest[number] = detection
    found = []
    for number, mask in cells.items():
        best = surest.get(number)
        confidence, category = (best.confidence, best.category) if best else (0.0, "")
        found.append(CellView(f"{scene.name}/{number}", float(mask.mean()), confidence, category))
    return DetectorViews(tuple(objects), tuple(found), 1)


def _shown_by(mask: Bool[np.ndarray, "h w"], instance_map: Int[np.ndarray, "h w"]) -> int:
    """The object that a mask is of, 0 for none."""
    numbers, counts = np.unique(instance_map[mask], return_counts=True)
    area = np.count_nonzero(mask)
    for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
        if number and count >= SAME_IOU * (area + np.count_nonzero(instance_map == number) - count):
            return number
    return 0


def _resized(mask: Bool[np.ndarray, "h w"], shape: tuple[int, ...]) -> Bool[np.ndarray, "H W"]:
    """A mask as a picture of another size shows it, by the nearest pixel."""
    return cv2.resize(mask.view(np.uint8), (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST_EXACT).astype(bool)
