"""What every 3-D detector offers: it lifts what a 2-D detector has found in one view to boxes in the world."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from labeling.core.episode import Episode
from labeling.core.types import Box3d, Detection


@dataclass(frozen=True)
class Detection3d:
    """A box in the world, found from one view."""

    view_index: int
    category: str
    confidence: float
    """In [0, 1]."""
    box: Box3d


class Detector3d(Protocol):
    """Lifts detections."""

    name: str
    """For people."""
    digest: str
    """Changes whenever its results might."""

    def lift(self, episode: Episode, detections: Sequence[Detection]) -> list[Detection3d]:
        """Boxes of detections; of those that have too few points on known depth, none.

        Args:
            episode: pictures, depth and poses of its views.
            detections: of the same views. Each is lifted from its own view alone.
        """
        ...
