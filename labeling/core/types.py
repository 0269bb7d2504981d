"""What is known about objects in views: detections, ground truth, pseudo-labels, 3-D boxes, motion."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

CONFIDENT = 0.9
"""Detections at least this confident are trusted as sources of labels, unless configured. Source: thesis A.2.2."""
MIN_POSTERIOR = 0.15
"""Objects that no view is sure of are labelled if the chance of their category reaches this, unless configured."""


SAME_POSE = 1e-6
"""Poses that differ by less, metres and entries of rotations, are one."""

BOX_EDGES = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1)
"""The edges of a box: pairs of indices into ``Box3d.corners()``."""


@dataclass(frozen=True)
class Box3d:
    """An oriented box in the world.

    Example:
        >>> box = Box3d(np.array([1.0, 2.0, 0.5]), np.array([0.4, 0.6, 1.0]), np.eye(3))
        >>> box.corners().max(axis=0)
        array([1.2, 2.3, 1. ])
    """

    centre_m: Float[np.ndarray, "3"]
    extent_m: Float[np.ndarray, "3"]
    """Full edge lengths along the box's own axes."""
    rotation: Float[np.ndarray, "3 3"]
    """Columns are the box's axes in the world."""

    def corners(self) -> Float[np.ndarray, "8 3"]:
        """The eight corners in the world, metres."""
        signs = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij"), axis=-1).reshape(8, 3)
        return self.centre_m + (signs * self.extent_m) @ self.rotation.T


@dataclass(frozen=True, eq=False)
class Detection:
    """What a detector says about one object in one view. Equal if all fields are, the mask pixel by pixel.

    Example:
        >>> mask = np.zeros((48, 64), bool)
        >>> mask[10:20, 30:50] = True
        >>> Detection(view_index=0, category="chair", confidence=0.93, mask=mask).mask.sum()
        np.int64(200)
    """

    view_index: int
    category: str
    confidence: float
    """In [0, 1]."""
    mask: Bool[np.ndarray, "h w"]
    exact: bool = False
    """Whether a person drew the mask, so that its outline is taken as exact and is not eroded."""
    box_xyxy: tuple[float, float, float, float] | None = None
    """Of a detector that gives boxes only: left, top, right, bottom in pixels, from which the mask was made here."""

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Detection)
            and (self.view_index, self.category, self.confidence, self.exact, self.box_xyxy)
            == (other.view_index, other.category, other.confidence, other.exact, other.box_xyxy)
            and np.array_equal(self.mask, other.mask)
        )


@dataclass(frozen=True)
class GroundTruth:
    """What the simulator (or an annotator) knows about one object in one view.

    Example:
        >>> truth = GroundTruth(view_index=0, instance_id=7, category="chair", modal=np.ones((48, 64), bool))
        >>> truth.amodal is None, truth.ignore
        (True, False)
    """

    view_index: int
    instance_id: int
    """Identifies the object across the views of an episode."""
    category: str
    modal: Bool[np.ndarray, "h w"]
    """The visible part."""
    amodal: Bool[np.ndarray, "h w"] | None = None
    """The whole object, as if nothing stood before it; None where unknown."""
    box_3d: Box3d | None = None
    ignore: bool = False
    """Neither rewarded nor punished in evaluation (COCO's iscrowd), such as a sliver nobody would annotate."""


@dataclass(frozen=True, eq=False)
class ObjectMotion:
    """Where one object is in every view of an episode. What has none stands still.

    Example:
        >>> poses = np.stack([np.eye(4), np.eye(4)])
        >>> poses[1, 0, 3] = 0.5
        >>> ObjectMotion(7, "car", poses).moves
        True
    """

    instance_id: int
    """As in the ground truth of the episode."""
    category: str
    object_to_world: Float[np.ndarray, "v 4 4"]
    """Pose of the object's own frame in each view, rigid; views in which the object is not seen have one as well."""

    @property
    def moves(self) -> bool:
        """Whether it is anywhere else in any view than in the first."""
        return bool(np.abs(self.object_to_world - self.object_to_world[:1]).max() > SAME_POSE)


@dataclass(frozen=True)
class PseudoLabel:
    """What the label generator says about one object in one view.

    Example:
        >>> seen, whole = np.eye(3, dtype=bool), np.ones((3, 3), bool)
        >>> label = PseudoLabel(4, 1, "chair", 0.8, seen, whole, source_view_index=0, source_confidence=0.95)
        >>> f"{label.category} in view {label.view_index}, {label.modal.sum()} of {label.amodal.sum()} pixels visible"
        'chair in view 4, 3 of 9 pixels visible'
    """

    view_index: int
    instance_id: int
    """Identifies the object across the views of an episode."""
    category: str
    confidence: float
    """In [0, 1]."""
    modal: Bool[np.ndarray, "h w"]
    """May be empty where only the amodal mask has pixels (the object is hidden in this view)."""
    amodal: Bool[np.ndarray, "h w"]
    source_view_index: int
    """The view of the confident detection this label stems from."""
    source_confidence: float
