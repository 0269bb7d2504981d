"""Full frames for the recorder: what one view shows, exactly, and how views become an episode on disk."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, UInt8

from labeling.core.episode import Episode
from labeling.core.types import Detection, GroundTruth, ObjectMotion
from labeling.io.coco import SLIVER_AREA_SHARE
from sbm_gym.env.view_detectors import View
from sbm_gym.scenes.compiled import Scene

SLIVER_VISIBLE_SHARE = 0.05
"""Objects of which a view shows less than this share of what it would show if nothing stood before them are marked
``ignore``, and so are those of which it shows less than ``SLIVER_AREA_SHARE`` of the picture."""


@dataclass(frozen=True)
class MovingObject:
    """Where something that may move is."""

    instance_id: int
    category: str
    object_to_world: Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Capture:
    """One full frame."""

    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float32[np.ndarray, "h w"]
    """z-depth, 0 = no return."""
    intrinsics: Float[np.ndarray, "3 3"]
    camera_to_world: Float[np.ndarray, "4 4"]
    """OpenCV axes."""
    detections: tuple[Detection, ...]
    """Of the env's detector in this very frame."""
    ground_truth: tuple[GroundTruth, ...]
    """What the simulator knows, for the recorder only: neither policies nor rewards may look at it."""
    moving: tuple[MovingObject, ...] = ()
    """Likewise: every object that may move in this episode, seen or not, and where it is."""


def moving_objects(scene: Scene, poses: Mapping[int, Float[np.ndarray, "4 4"]]) -> tuple[MovingObject, ...]:
    """What may move in a scene, and where it is.

    Args:
        scene: the scene.
        poses: object to world, by instance id.
    """
    return tuple(
        MovingObject(one.instance_id, one.category, poses[one.instance_id])
        for one in scene.world.objects
        if one.instance_id in poses
    )


def ground_truth_of_view(scene: Scene, view: View, view_index: int) -> tuple[GroundTruth, ...]:
    """Modal and amodal masks and 3-D boxes of every object of which at least one pixel shows.

    Args:
        scene: in which the view was taken.
        view: the view.
        view_index: its number in its episode.
    """
    instance_map = view.instance_map
    found = []
    shown = set(np.unique(instance_map).tolist())
    for instance in scene.world.objects:
        if instance.instance_id not in shown:
            continue
        modal = instance_map == instance.instance_id
        geoms = scene.geoms_of_instance[instance.instance_id]
        # What is seen belongs to the whole by definition; rays cast a second time may differ in a rim pixel.
        amodal = modal | scene.renderer.amodal_mask(scene.data, geoms, view.camera)
        modal_px, amodal_px = np.count_nonzero(modal), np.count_nonzero(amodal)
        sliver = modal_px < SLIVER_AREA_SHARE * modal.size or modal_px < SLIVER_VISIBLE_SHARE * amodal_px
        found.append(
            GroundTruth(
                view_index=view_index,
                instance_id=instance.instance_id,
                category=instance.category,
                modal=modal,
                amodal=amodal,
                box_3d=instance.box_3d,
                ignore=bool(sliver),
            )
        )
    return tuple(found)


def episode_of_captures(
    captures: Sequence[Capture], categories: Sequence[str], metadata: dict[str, Any], name: str = ""
) -> Episode:
    """The episode that these frames make, in order; view indices are numbered anew.

    Args:
        captures: at least one frame, all of one size.
        categories: what detector and ground truth may speak of.
        metadata: content of ``episode.json``.
        name: name of the episode's folder.

    Raises:
        ValueError: if there is no frame.
    """
    if not captures:
        raise ValueError("an episode needs at least one frame")
    return Episode(
        name=name,
        rgb=np.stack([capture.rgb for capture in captures]),
        depth_m=np.stack([capture.depth_m for capture in captures]),
        intrinsics=np.stack([capture.intrinsics for capture in captures]),
        camera_to_world=np.stack([capture.camera_to_world for capture in captures]),
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(len(captures))),
        detections=tuple(
            replace(detection, view_index=view) for view, c in enumerate(captures) for detection in c.detections
        ),
        ground_truth=tuple(
            replace(label, view_index=view) for view, c in enumerate(captures) for label in c.ground_truth
        ),
        categories=tuple(categories),
        metadata=metadata,
        motion=_motion_of(captures),
    )


def _motion_of(captures: Sequence[Capture]) -> tuple[ObjectMotion, ...] | None:
    """The motion of everything that may move in all of these frames; None if nothing may."""
    if not captures[0].moving:
        return None
    return tuple(
        ObjectMotion(first.instance_id, first.category, np.stack([one.moving[k].object_to_world for one in captures]))
        for k, first in enumerate(captures[0].moving)
    )
