"""An episode: posed RGB-D views of one scene, with detections and ground truth where known."""

from dataclasses import dataclass, field
from typing import Any

from labeling.core.types import Detection, GroundTruth, ObjectMotion
from labeling.core.views import RgbdViews


@dataclass(frozen=True, eq=False)
class Episode(RgbdViews):
    """The views of one episode, in the order they were taken, and what is known about them.

    Example:
        >>> import numpy as np
        >>> views = RgbdViews(
        ...     rgb=np.zeros((1, 48, 64, 3), np.uint8),
        ...     depth_m=np.ones((1, 48, 64), np.float32),
        ...     intrinsics=np.diag([60.0, 60.0, 1.0])[None],
        ...     camera_to_world=np.eye(4)[None],
        ... )
        >>> episode = Episode(**vars(views), name="kitchen", file_names=("rgb/000.png",))
        >>> episode.num_views, episode.detections is None
        (1, True)
    """

    name: str
    """Name of the episode's folder; empty for an episode that never was on disk."""
    file_names: tuple[str, ...]
    """Colour files, relative to the episode's folder."""
    detections: tuple[Detection, ...] | None = None
    """None if no detector has run."""
    ground_truth: tuple[GroundTruth, ...] | None = None
    """None if unknown."""
    categories: tuple[str, ...] = ()
    """Names of the categories that detector and ground truth speak of."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """Content of episode.json."""
    frame_names: tuple[str, ...] = ()
    """Colour files of all frames of the recording, if some of them were left out; they count in image ids."""
    notes: tuple[str, ...] = ()
    """What its reader left out or had to change, one sentence each."""
    motion: tuple[ObjectMotion, ...] | None = None
    """Where the objects are that may move; None if unknown, or nothing moves."""
