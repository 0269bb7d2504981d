"""What the label generator finds in one episode: objects, masks, and the segmented cloud."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32

from labeling.core.pose_check import PoseCheck
from labeling.core.types import Box3d, PseudoLabel


@dataclass(frozen=True)
class Scale:
    """The scale of an episode, measured on its confident detections."""

    object_m: float
    """Median over the detections of the square root of the area they cover."""
    pixel_m: float
    """Median distance between neighbouring pixels on the detected objects."""


@dataclass(frozen=True)
class Source:
    """A confident detection that an object was labelled from."""

    view_index: int
    confidence: float
    category: str


@dataclass(frozen=True)
class Place:
    """Where an object that has moved was in some views."""

    box_3d: Box3d | None
    """None if no point was left for it."""
    view_indices: tuple[int, ...]
    """Those that show it there, ascending."""


@dataclass(frozen=True)
class LabelledObject:
    """One object of an episode."""

    instance_id: int
    """1, 2, ... within the episode."""
    category: str
    confidence: float
    """In [0, 1]: how far its sources are sure and agree."""
    box_3d: Box3d | None
    """None if no point was left for it, or if it is in several places."""
    sources: tuple[Source, ...]
    """The most confident first."""
    posterior: Mapping[str, float] | None = None
    """Probability of each category; the rest to 1 is that of background. None where a person said what it is, or nobody
    asked."""
    places: tuple[Place, ...] = ()
    """Of what has moved: where it was. Empty for what stands still."""
    only_here: bool = False
    """Whether it stands still in this episode, and not where it stands in others of the scene."""


@dataclass(frozen=True, eq=False)
class IgnoredRegion:
    """A region that is neither surely an object nor surely background: nobody should learn from it."""

    view_index: int
    category: str
    """What it might be."""
    confidence: float
    """In [0, 1]."""
    mask: Bool[np.ndarray, "h w"]
    instance_id: int | None = None
    """The object whose label is below the confidence threshold here; None for a detection that no label explains."""


@dataclass(frozen=True)
class SegmentedCloud:
    """The points of an episode and the object each belongs to."""

    points: Float[np.ndarray, "n 3"]
    """Metres, world; of 32 bits, or of 64 where the recording is far from the origin of its world frame."""
    colours: Float32[np.ndarray, "n 3"]
    """In [0, 1]."""
    instance_id: Int32[np.ndarray, "n"]
    """0 for none."""
    probability: Float32[np.ndarray, "n k"]
    """Of each object, in the order of ``EpisodeLabels.objects``."""

    @property
    def confidence(self) -> Float32[np.ndarray, "n"]:
        """Probability that a point belongs to the object (or to none) it is labelled with."""
        if self.probability.shape[1] == 0:
            return np.ones(len(self.points), np.float32)
        own = np.take_along_axis(self.probability, np.maximum(self.instance_id - 1, 0)[:, None], axis=1)[:, 0]
        return np.where(self.instance_id > 0, own, 1 - self.probability.max(axis=1)).astype(np.float32)


@dataclass(frozen=True)
class EpisodeLabels:
    """What the label generator found in one episode.

    Example:
        >>> points, none = np.zeros((1, 3), np.float32), np.zeros(1, np.int32)
        >>> cloud = SegmentedCloud(points, points, none, np.zeros((1, 0), np.float32))
        >>> EpisodeLabels(objects=(), labels=(), cloud=cloud, scale=None).cloud.confidence
        array([1.], dtype=float32)
    """

    objects: tuple[LabelledObject, ...]
    labels: tuple[PseudoLabel, ...]
    """Of every object in every view where it has a mask, sorted by view."""
    cloud: SegmentedCloud
    scale: Scale | None
    """None if no usable detection lies on known depth (there are no labels then)."""
    ignored: tuple[IgnoredRegion, ...] = ()
    """Regions that neither labels nor background cover, sorted by view: unsure labels and unexplained detections."""
    poses: PoseCheck | None = None
    """How well the views' poses agree with their depths, and those that were used instead; None if nothing was labelled
    or no two views see enough of one another."""
