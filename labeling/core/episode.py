"""An episode as arrays: posed RGB-D views of one scene, with detections and ground truth where known."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, UInt8

from labeling.core.types import Detection, GroundTruth

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Episode:
    """The views of one episode as arrays, in the order they were taken."""

    name: str
    """Name of the episode's folder; empty for an episode that never was on disk."""
    rgb: UInt8[np.ndarray, "views h w 3"]
    depth_m: Float32[np.ndarray, "views h w"]
    """z-depth, 0 = no return."""
    intrinsics: Float[np.ndarray, "views 3 3"]
    camera_to_world: Float[np.ndarray, "views 4 4"]
    """OpenCV camera axes."""
    file_names: tuple[str, ...]
    """Colour files, relative to the episode's folder."""
    detections: tuple[Detection, ...] | None = None
    """None if no detector has looked."""
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

    @property
    def num_views(self) -> int:
        """How many views there are."""
        return len(self.rgb)

    @property
    def size(self) -> tuple[int, int]:
        """Picture height and width in pixels."""
        return self.rgb.shape[1], self.rgb.shape[2]
